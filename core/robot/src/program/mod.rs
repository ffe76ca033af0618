//! What the robot does with bytes and time: see the [crate](crate).

mod fit;
mod laser;
mod machine;
mod mapping;
mod paging;
mod pools;
mod report;
mod requests;
mod square;
mod sweep_report;
mod words;

pub use fit::Misfit;
pub use machine::{Input, Ports, Robot};
pub use mapping::{Mapped, Mapping};
pub use pools::{CompactPools, LargePools, Pools, RobotMemory, RobotPools, StandardPools};
