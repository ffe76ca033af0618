//! Entry `hosts`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("hosts", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/hosts")),
    |input: &[u8]| lrfslam_tests::entries::hosts(input)
);
