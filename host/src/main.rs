//! The command `lrfslam`.
fn main() {}
