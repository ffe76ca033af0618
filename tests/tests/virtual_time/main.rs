//! Both ends together, as fast as the computer is. One binary for all, linked once.

mod bags;
mod bare_corridor;
mod closing_loops;
mod encodings;
mod fuzzed;
mod hil_virtual;
mod keys;
mod landmarks;
mod larger_than_memory;
mod link_faults;
mod map3d;
mod memory;
mod one_slam;
mod passers_by;
mod recorded_log;
mod refused_configuration;
mod small_pools;
mod spinning_faults;
mod wire_golden;
