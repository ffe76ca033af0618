use super::*;
use proptest::prelude::*;

fn acquire() -> impl Strategy<Value = Acquire> {
    let encoding = prop_oneof![Just(Encoding::Short), Just(Encoding::Long), Just(Encoding::Intensity)];
    (encoding, any::<bool>(), 0_u16..10_000, 0_u16..10_000, 0_u8..100).prop_map(
        |(encoding, multi_echo, first, last, cluster)| Acquire {
            encoding,
            // There is no two-character command with several echoes: `HS` is the sensitivity.
            multi_echo: multi_echo && encoding != Encoding::Short,
            first,
            last,
            cluster,
        },
    )
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Version),
        Just(Command::Parameters),
        Just(Command::Information),
        Just(Command::LaserOn),
        Just(Command::Quit),
        Just(Command::Reset),
        Just(Command::ResetKeepingRate),
        Just(Command::Reboot),
        Just(Command::State),
        Just(Command::Sleep),
        Just(Command::SwitchToScip2),
        Just(Command::Time(TimeMode::Read)),
        acquire().prop_map(Command::Get),
        (acquire(), 0_u8..10, 0_u8..100).prop_map(|(acquire, interval, count)| Command::Stream {
            acquire,
            interval,
            count
        }),
        (0_u32..1_000_000).prop_map(Command::BitRate),
        (0_u8..100).prop_map(Command::MotorSpeed),
        any::<bool>().prop_map(Command::Sensitivity),
        (0_u8..100).prop_map(Command::Malfunction),
    ]
}

proptest! {
    #[test]
    fn parse_undoes_emit(command in command()) {
        prop_assert_eq!(Command::parse(&command.emit()), Ok(command));
    }

    #[test]
    fn any_line_is_parsed_or_refused(line in proptest::collection::vec(any::<u8>(), 0..40)) {
        let _ = split_tag(&line).and_then(|(command, _)| Command::parse(command));
    }
}

#[test]
fn captured_commands_are_emitted_byte_for_byte() {
    let acquire = Acquire { encoding: Encoding::Long, multi_echo: false, first: 44, last: 725, cluster: 1 };
    assert_eq!(Command::Get(acquire).emit(), b"GD0044072501");
    let acquire = Acquire { encoding: Encoding::Intensity, first: 0, last: 1080, ..acquire };
    assert_eq!(Command::Stream { acquire, interval: 1, count: 1 }.emit(), b"ME0000108001101");
    assert_eq!(Command::BitRate(19_200).emit(), b"SS019200");
    assert_eq!(Command::MotorSpeed(0).emit(), b"CR00");
}

#[test]
fn wrong_commands_get_the_status_of_the_manual() {
    for (line, status) in [
        ("XY", Status::UNDEFINED),
        ("V", Status::UNDEFINED),
        ("MD00", Status::TOO_SHORT),
        ("GD00x4072501", Status::code(1)),
        ("GD0044a72501", Status::code(2)),
        ("GD00440725b1", Status::code(3)),
        ("MD0044072501x00", Status::code(6)),
        ("MD00440725010x0", Status::code(7)),
        ("SS01920x", Status::code(1)),
        ("SS100000000", Status::UNDEFINED_1),
        ("CR255", Status::UNDEFINED_1),
        ("DB100", Status::UNDEFINED_1),
        ("TM7", Status::code(1)),
    ] {
        assert_eq!(Command::parse(line.as_bytes()), Err(status), "{line}");
    }
    assert_eq!(split_tag(b"VV;01234567890123456"), Err(Status::TAG_TOO_LONG));
    assert_eq!(split_tag(b"VV;a-b"), Err(Status::BAD_TAG));
    assert_eq!(split_tag(b"VV;a.b @+_"), Ok((&b"VV"[..], Some(&b"a.b @+_"[..]))));
}

#[test]
fn last_short_cluster_counts_either_way() {
    let acquire = Acquire { encoding: Encoding::Long, multi_echo: false, first: 0, last: 9, cluster: 3 };
    assert_eq!(acquire.value_counts(), (3, 4));
    assert_eq!(Acquire { cluster: 0, ..acquire }.value_counts(), (10, 10));
}
