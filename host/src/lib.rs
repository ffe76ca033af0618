//! Laser SLAM on a computer: logs in, maps and trajectories out.
#![forbid(unsafe_code)]
