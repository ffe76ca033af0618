//! A robot with a key: it maps as one without, whatever others put into its line.

use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::message::ToRobot;
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};
use lrfslam_tests::robot_rig::{Build, Disk, LineFaults, RobotRig};

use crate::link_faults::{DRIVE, LASER_AT, check_same, config, finish, good};

const KEY: Key = Key::new([7; 32]);
/// Somebody speaks so often during the drive.
const STRANGERS: i64 = 200;

fn rig(faults: LineFaults, seed: u64) -> RobotRig {
    let scene = Box::new(Scenario::load("floor").expect("comes with the program").scene());
    let device = Box::new(VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), scene, 1));
    let mut rig = RobotRig::with(Disk::default(), Box::new(|| Build::Standard.memory(&[])), device, &config());
    rig.set_key(KEY);
    rig.set_faults(faults, seed);
    rig.start();
    rig.run_for(LASER_AT);
    rig
}

fn framed(payload: &[u8]) -> Vec<u8> {
    encode(payload, &mut [0; MAX_FRAME]).expect("it fits").to_vec()
}

/// What a host without the key says that wants the robot to stop, to begin anew, and to talk to him.
fn strangers() -> Vec<Vec<u8>> {
    let packed = |packet: &Packet<'_>| framed(postcard::to_slice(packet, &mut [0; 200]).expect("it fits"));
    let said = |message: &ToRobot<'_>| postcard::to_slice(message, &mut [0; 100]).expect("it fits").to_vec();
    let [stop, restart] = [said(&ToRobot::Stop), said(&ToRobot::Restart)];
    let (version, layout) = (VERSION, LAYOUT);
    // The epochs of the rig's host and of its robot.
    let hello =
        |epoch| Packet::Hello { version, epoch, peer: Some(1), next: 0, base: 0, credit: 32, is_heard: true, layout };
    let sealed = |packet: &[u8]| framed(&[&[67, 0, 1, 0, 0][..], packet, &[0; 16]].concat());
    let mut frames = vec![packed(&hello(100)), packed(&hello(7)), framed(&[64]), framed(&[65; 17]), framed(&[66; 49])];
    for message in [&stop, &restart] {
        let packet = Packet::Reliable { epoch: 100, sequence: 1, message };
        frames.push(packed(&packet));
        frames.push(sealed(message));
    }
    frames.push(packed(&Packet::Busy { peer: 100 }));
    frames
}

#[test]
fn a_key_changes_nothing_of_what_is_mapped_on_good_lines_and_bad_ones() {
    let wanted = good();
    for (seed, faults) in [LineFaults::default(), LineFaults::all(0.01)].into_iter().enumerate() {
        let mut rig = rig(faults, seed as u64);
        rig.plug_laser(true);
        rig.run_for(DRIVE);
        finish(&mut rig);
        assert_eq!(rig.disk.lives.len(), 1);
        check_same(&rig.disk.lives[0], &wanted);
    }
}

#[test]
fn two_hundred_strangers_on_the_line_move_nothing() {
    let wanted = good();
    let mut rig = rig(LineFaults::default(), 1);
    rig.plug_laser(true);
    let strangers = strangers();
    for number in 0..STRANGERS {
        strangers.iter().for_each(|frame| rig.put_in(frame));
        let until = DRIVE.micros * (number + 1) / STRANGERS - DRIVE.micros * number / STRANGERS;
        rig.run_for(Duration::from_micros(until));
    }
    finish(&mut rig);
    assert_eq!(rig.disk.lives.len(), 1, "it was not started anew");
    check_same(&rig.disk.lives[0], &wanted);
    assert!(rig.refused() >= 200 * 6, "{}", rig.refused());
}
