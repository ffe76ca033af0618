//! LDROBOT LD06 and LD19: small lasers that spin and talk by themselves, and take no commands.
//!
//! 230400 baud. Each packet has twelve samples; angles grow clockwise from straight ahead.
//!
//! Not here: the speed control of LD06's separate PWM pin, models with other packets.
//!
//! Sources: maker, *LD06 development manual* v1.0 (packet, example, left-handed coordinates); maker's driver
//! ldlidar_stl_ros2, `lipkg.cpp` (polynomial of the check sum; 4500 samples a second); inno-maker's product page (packet).

pub mod driver;
pub mod packet;

pub use driver::LdrobotDriver;
pub use packet::{Packet, PacketDecoder, Point};
