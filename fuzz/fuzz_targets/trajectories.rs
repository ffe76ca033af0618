//! Entry `trajectories`: see `lrfslam_tests::entries`.
#![no_main]

libfuzzer_sys::fuzz_target!(
    init: lrfslam_tests::samples::write("trajectories", concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/trajectories")),
    |input: &[u8]| lrfslam_tests::entries::trajectories(input)
);
