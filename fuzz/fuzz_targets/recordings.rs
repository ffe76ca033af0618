//! Entry `recordings`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("recordings", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/recordings")),
    |input: &[u8]| lrfslam_tests::entries::recordings(input)
);
