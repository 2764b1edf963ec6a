//! Any text as a configuration: one that is taken and valid is written and read again as it is.
//!
//! `cargo +nightly fuzz run config fuzz/corpus/config fuzz/seeds/config -- -max_total_time=60`

#![no_main]

use ipslam::config::{LocalizationConfig, SlamConfig};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    if let Ok(config) = SlamConfig::default().with_toml(text)
        && config.validate().is_ok()
    {
        let written = toml::to_string(&config).expect("a configuration can be written");
        assert_eq!(SlamConfig::default().with_toml(&written).ok(), Some(config));
    }
    if let Ok(config) = LocalizationConfig::default().with_toml(text)
        && config.validate().is_ok()
    {
        let written = toml::to_string(&config).expect("a configuration can be written");
        assert_eq!(LocalizationConfig::default().with_toml(&written).ok(), Some(config));
    }
});
