//! Hands the linker the memory of the chosen board.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let has = |feature: &str| env::var_os(format!("CARGO_FEATURE_{feature}")).is_some();
    let board = match (has("MPS2_AN500"), has("MPS2_AN386"), has("NUCLEO_H743ZI")) {
        (true, false, false) => "mps2-an500",
        (false, true, false) => "mps2-an386",
        (false, false, true) => "nucleo-h743zi",
        _ => panic!("choose one board: --features mps2-an500, mps2-an386 or nucleo-h743zi"),
    };
    let size = if has("COMPACT") { "-compact" } else { "" };
    let memory = format!("memory/{board}{size}.x");
    fs::copy(&memory, out.join("memory.x")).unwrap_or_else(|error| panic!("{memory}: {error}"));
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rerun-if-changed=memory");
}
