//! How a part of the configuration is declared: each field with its meaning, unit, default and range in one place.

use serde::Serialize;
use std::ops::RangeInclusive;

/// Why a configuration cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The text is no TOML, or a key of it is unknown or of another type.
    #[error("the configuration cannot be understood: {0}")]
    Toml(#[from] toml::de::Error),
    /// A value out of its range.
    #[error("{name} is {value}, but has to be {expected}")]
    Value {
        /// The key in a file, with the option, if any.
        name: String,
        /// The value.
        value: String,
        /// The values that are possible.
        expected: String,
    },
}

impl ConfigError {
    pub(crate) fn value(name: &str, value: impl ToString, expected: impl Into<String>) -> Self {
        Self::Value { name: name.to_owned(), value: value.to_string(), expected: expected.into() }
    }
}

/// A number that a configuration may hold.
pub(crate) trait Number: Copy + ToString {
    fn as_f64(self) -> f64;
}

impl Number for f64 {
    fn as_f64(self) -> f64 {
        self
    }
}

impl Number for usize {
    fn as_f64(self) -> f64 {
        self as f64
    }
}

impl Number for u32 {
    fn as_f64(self) -> f64 {
        f64::from(self)
    }
}

/// Checks that a number is in its range; `name` is its key in a file.
pub(crate) fn check(name: &str, value: impl Number, range: RangeInclusive<f64>) -> Result<(), ConfigError> {
    if range.contains(&value.as_f64()) {
        return Ok(());
    }
    Err(ConfigError::value(name, value, in_words(&range)))
}

/// This configuration, with the parts that a TOML text sets in place of its own.
pub(crate) fn with_toml<T: Serialize + serde::de::DeserializeOwned>(base: &T, text: &str) -> Result<T, ConfigError> {
    // Read as a whole configuration first: only so do errors know their line.
    toml::from_str::<T>(text)?;
    // TOML's integers end at 2⁶³ - 1; only a seed comes near.
    let mut table = toml::Table::try_from(base)
        .map_err(|_| ConfigError::value("seed (option --seed)", "too large", format!("at most {}", i64::MAX)))?;
    overlay(&mut table, toml::from_str(text)?);
    Ok(table.try_into()?)
}

fn overlay(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => overlay(base, over),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}

/// Checks a seed: TOML cannot hold larger ones, and a run writes its configuration.
pub(crate) fn check_seed(seed: u64) -> Result<(), ConfigError> {
    i64::try_from(seed)
        .map(|_| ())
        .map_err(|_| ConfigError::value("seed (option --seed)", seed, format!("at most {}", i64::MAX)))
}

/// The documentation of one parameter.
pub(crate) struct Parameter {
    pub name: &'static str,
    /// Its meaning, by lines.
    pub meaning: &'static [&'static str],
    /// As TOML has it.
    pub default: String,
    pub range: Option<RangeInclusive<f64>>,
}

/// A section of the configuration that lists its parameters.
pub(crate) trait Section {
    fn parameters() -> Vec<Parameter>;
}

impl Parameter {
    pub(crate) fn new(name: &'static str, meaning: &'static [&'static str], default: impl Serialize) -> Self {
        // Every value of a configuration can be written in TOML.
        let default = toml::Value::try_from(default).map_or_else(|_| String::new(), |value| value.to_string());
        Self { name, meaning, default, range: None }
    }

    /// As TOML: its meaning and range as comments, and the default.
    pub(crate) fn explained(&self) -> String {
        let Self { name, meaning, default, range } = self;
        let meaning: String =
            meaning.iter().map(|line| format!("# {}\n", line.trim().replace("\\[", "[").replace("\\]", "]"))).collect();
        let range = range.as_ref().map_or_else(String::new, |range| format!("# Range: {}.\n", in_words(range)));
        format!("{meaning}{range}{name} = {default}\n\n")
    }
}

fn in_words(range: &RangeInclusive<f64>) -> String {
    let most = if range.end().is_finite() { format!(" to {}", range.end()) } else { " or more".to_owned() };
    format!("{}{most}", range.start())
}

/// A section as TOML, with its documentation.
pub(crate) fn explained<S: Section>(section: &str) -> String {
    let parameters: String = S::parameters().iter().map(Parameter::explained).collect();
    format!("[{section}]\n{parameters}")
}

/// Declares a section of the configuration. Each field is `name: type = default, in range;`, or `name: type = default;`
/// where every value is possible. The struct gets these defaults, a check of all ranges, and both in its documentation.
macro_rules! parameters {
    (
        $(#[$meta:meta])*
        pub struct $section:ident {
            $( $(#[doc = $doc:literal])+ $field:ident: $type:ty = $default:expr $(, in $range:expr)?; )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $section {
            $(
                $(#[doc = $doc])+
                #[doc = concat!("\n\nDefault `", stringify!($default), "`" $(, "; range `", stringify!($range), "`")?, ".")]
                pub $field: $type,
            )+
        }

        impl Default for $section {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }

        impl crate::parameters::Section for $section {
            fn parameters() -> Vec<crate::parameters::Parameter> {
                let defaults = Self::default();
                vec![$({
                    let parameter =
                        crate::parameters::Parameter::new(stringify!($field), &[$($doc),+], defaults.$field);
                    $(let parameter = crate::parameters::Parameter { range: Some($range), ..parameter };)?
                    parameter
                },)+]
            }
        }

        impl $section {
            /// Whether every number is in its range; `section` is the name of this part in a file.
            pub(crate) fn check(&self, section: &str) -> Result<(), crate::parameters::ConfigError> {
                let _ = section;
                $($(crate::parameters::check(&format!("{section}.{}", stringify!($field)), self.$field, $range)?;)?)+
                Ok(())
            }
        }
    };
}
pub(crate) use parameters;
