//! Builds the page into `target/page`: the library as WebAssembly, with the JavaScript that loads it, beside the files of `web/page`.

use anyhow::{Context as _, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};
use wasm_bindgen_cli_support::Bindgen;

const TARGET: &str = "wasm32-unknown-unknown";
/// Vectors of 128 bits: every browser has had them since 2023.
const FLAGS: &str = "-Ctarget-feature=+simd128";
const NAME: &str = "ipslam_web";

fn main() -> anyhow::Result<()> {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).parent().context("the folder `web` is gone")?;
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| web.with_file_name("target"), PathBuf::from);
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .args(["build", "--package", "ipslam-web", "--profile", "web", "--target", TARGET, "--target-dir"])
        .arg(&target)
        .env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", FLAGS)
        .current_dir(web)
        .status()?;
    ensure!(
        built.success(),
        "cargo could not build it; `rustup target add {TARGET}` gets the target where it is missing"
    );

    let page = target.join("page");
    Bindgen::new()
        .input_path(target.join(TARGET).join("web").join(NAME).with_extension("wasm"))
        .web(true)?
        .typescript(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(&page)?;
    for file in fs::read_dir(web.join("page"))? {
        let file = file?;
        fs::copy(file.path(), page.join(file.file_name()))?;
    }
    let size = fs::metadata(page.join(format!("{NAME}_bg.wasm")))?.len();
    println!("{}: open it through a server, such as `python3 -m http.server --directory {0}`", page.display());
    println!("{:.2} MB of WebAssembly", size as f64 / 1e6);
    Ok(())
}
