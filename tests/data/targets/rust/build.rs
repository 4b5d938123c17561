//! Compiles the stepper by $CC, or by cc: no crate is needed.
use std::{env, path::Path, process::Command};

fn run(command: &mut Command) {
    match command.status() {
        Ok(status) if status.success() => {}
        Ok(status) => panic!("{command:?} ended with {status}"),
        Err(error) => panic!("{command:?} does not start ({error}): set CC and AR"),
    }
}

fn main() {
    let out = env::var("OUT_DIR").unwrap();
    let name = env::var("CARGO_PKG_NAME").unwrap();
    let object = Path::new(&out).join("stepper.o");
    let library = Path::new(&out).join("libstepper.a");
    let compiler = env::var("CC").unwrap_or_else(|_| "cc".into());
    let mut words = compiler.split_whitespace();
    run(Command::new(words.next().unwrap_or("cc"))
        .args(words)
        .args(["-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-c"])
        .arg(format!("c/{name}.c"))
        .arg("-o")
        .arg(&object));
    run(Command::new(env::var("AR").unwrap_or_else(|_| "ar".into()))
        .arg("crs")
        .arg(&library)
        .arg(&object));
    println!("cargo:rerun-if-changed=c");
    println!("cargo:rerun-if-env-changed=CC");
    println!("cargo:rustc-link-search=native={out}");
    println!("cargo:rustc-link-lib=static=stepper");
    if env::var("CARGO_CFG_TARGET_FAMILY").as_deref() == Ok("unix") {
        println!("cargo:rustc-link-lib=m");
    }
}
