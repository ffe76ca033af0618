//! Entry `images`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("images", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/images")),
    |input: &[u8]| lrfslam_tests::entries::images(input)
);
