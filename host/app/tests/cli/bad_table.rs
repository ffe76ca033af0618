//! A table of bad inputs across every command, and what each got: an end within seconds, an exit code that says so, and words; never a panic.
//!
//! The table is written to `target/bad-inputs.md`.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::{flaser, lrfslam, run};

/// Numbers that an option does not take; some take the one or the other.
const NUMBERS: [&str; 7] = ["nan", "-inf", "-1", "1e308", "abc", "", "99999999999999999999"];

/// Commands with an option that wants a number, and the option.
const OPTIONS: [(&str, &str); 17] = [
    ("map ok.log --matcher-only --scans 3", "--seed"),
    ("map ok.log --matcher-only", "--scans"),
    ("map ok.log --matcher-only --scans 3", "--save-every"),
    ("map ok.log --scans 3", "--particles"),
    ("map ok.log --scans 3", "--levels"),
    ("map ok.log --scans 3", "--threads"),
    ("map ok.log --continue map", "--start"),
    ("localize ok.log --map map", "--start"),
    ("replay ok.rec --fast", "--seed"),
    ("run --lrf hokuyo --port none", "--record-max"),
    ("run --lrf hokuyo --port none", "--baud"),
    ("run --lrf hokuyo --port none", "--cluster"),
    ("attach --lrf hokuyo --port none", "--lrf-baud"),
    ("attach --lrf hokuyo --port none", "--cluster"),
    ("attach --lrf hokuyo --port none", "--link-baud"),
    ("eval ok.tum --truth ok.tum", "--tolerance"),
    ("eval ok.tum --truth ok.tum", "--stretch"),
];

/// Commands that read a file, whose place is `{}`.
const READERS: [&str; 10] = [
    "map {}",
    "map ok.log --config {}",
    "map ok.log --continue {}",
    "replay {} --fast",
    "localize {} --map map",
    "localize ok.log --map {}",
    "eval {} --truth ok.tum",
    "eval ok.tum --truth {}",
    "doctor {}",
    "cloud {} --trajectory ok.tum --tilt tilt.txt",
];

/// Further lines, each wrong in its own way.
const LINES: [&str; 28] = [
    "",
    "nonsense",
    "map",
    "map ok.log extra",
    "map ok.log --no-such-flag",
    "map ok.log --set ndt.noise_m=nan",
    "map ok.log --set ndt.noise_m=1e308",
    "map ok.log --set ndt.noise_m",
    "map ok.log --set no.such=1",
    "map ok.log --set map.cell_size_m=0",
    "map ok.log --set map.draw_range_m=-1",
    "map ok.log --set map.draw_range_m=1000 --set map.cell_size_m=0.005",
    "map ok.log --out /dev/null",
    "map ok.log --out ok.log",
    "map ok.log --out /proc/nowhere",
    "map ok.log --resume",
    "map ok.log --resume --out nowhere",
    "map ok.log --resume --overwrite --out map",
    "map ok.log --start 0,0,0",
    "run --lrf hokuyo",
    "run --port none",
    "run --lrf nonsense --port none",
    "run --lrf sick-lms2xx --port tcp:127.0.0.1:1",
    "run --lrf hokuyo --port none --record /dev/null",
    "run --lrf hokuyo --port none --record map",
    "attach --port none",
    "attach --lrf hokuyo --port none --resume --out map",
    "attach --lrf hokuyo --port none --resume --restart --out map",
];

/// What is in a file that is wrong, and its name.
fn bad_files(folder: &Path) -> Vec<String> {
    let ok = fs::read(folder.join("ok.rec")).unwrap();
    let saved = fs::read(folder.join("map/map.lrfslam")).unwrap();
    let flipped = |bytes: &[u8], at: usize| {
        let mut bytes = bytes.to_vec();
        bytes[at] ^= 0x10;
        bytes
    };
    let line = flaser(1, 180);
    let files: Vec<(&str, Vec<u8>)> = vec![
        ("empty", Vec::new()),
        ("zeros", vec![0; 100_000]),
        ("noise", (0..50_000_u64).map(|n| (n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u8).collect()),
        ("one-line", vec![b'x'; 3 << 20]),
        ("count", b"FLASER 99999999999999999999 1 2 3\n".to_vec()),
        ("nan", line.replacen("3.00", "nan", 1).into_bytes()),
        ("huge", line.replace("3.00", "1e308").into_bytes()),
        ("packed", [&[0x1f, 0x8b, 8, 0][..], &[7; 100]].concat()),
        ("header", ok[..40].to_vec()),
        ("head-flip", flipped(&ok, 5)),
        ("map-cut", saved[..saved.len() / 2].to_vec()),
        ("toml", b"[ndt]\nnoise_m = \"\x1b[2J\"\n".to_vec()),
        ("poses", b"1 1e308 0 0 0 0 0 1\n2 nan 0 0 0 0 0 1\n".to_vec()),
    ];
    let name = |(name, bytes): (&str, Vec<u8>)| {
        // Some commands take a folder: in it lies the same as a saved map and as a recording.
        let place = folder.join(format!("{name}.d"));
        fs::create_dir(&place).unwrap();
        ["map.lrfslam", "laser.rec"].iter().for_each(|name| fs::write(place.join(name), &bytes).unwrap());
        fs::write(folder.join(name), bytes).unwrap();
        [name.to_owned(), format!("{name}.d")]
    };
    let mut names: Vec<String> = files.into_iter().flat_map(name).collect();
    names.extend(["nowhere".to_owned(), "/dev/null".to_owned(), "map".to_owned()]);
    names
}

/// What is right, to be spoiled.
fn prepare(folder: &Path) {
    fs::write(folder.join("ok.log"), (0..30).map(|i| flaser(i, 180)).collect::<String>()).unwrap();
    let poses: String = (0..30).map(|i| format!("{i} {} 0 0 0 0 0 1\n", 0.1 * f64::from(i))).collect();
    fs::write(folder.join("ok.tum"), poses).unwrap();
    fs::write(folder.join("tilt.txt"), (0..30).map(|i| format!("{i} 0.1\n")).collect::<String>()).unwrap();
    crate::spinning::write_recording(&folder.join("ok.rec"));
    assert_eq!(run(folder, &["map", "ok.log", "--out", "map", "-q"]).0, 0);
}

/// Exit code and words of a command that must come to an end.
fn got(folder: &Path, words: &[&str]) -> (i32, String) {
    let mut child = lrfslam(folder, words)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it starts");
    let started = Instant::now();
    while child.try_wait().expect("it is ours").is_none() {
        assert!(started.elapsed() < Duration::from_secs(60), "{words:?}: does not end");
        std::thread::sleep(Duration::from_millis(2));
    }
    let done = child.wait_with_output().expect("it is ours");
    let said = String::from_utf8(done.stderr).expect("words");
    let code = done.status.code().unwrap_or_else(|| panic!("{words:?}: killed by a signal: {said}"));
    assert!(code != 101 && !said.contains("panicked"), "{words:?}: {said}");
    assert!(
        !said.contains(|letter: char| letter.is_control() && letter != '\n' && letter != '\t'),
        "{words:?}: {said:?}"
    );
    (code, said)
}

#[test]
fn bad_inputs_across_every_command_get_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let split = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let mut lines: Vec<Vec<String>> = LINES.iter().map(|line| split(line)).collect();
    for (command, option) in OPTIONS {
        let with = |number: &&str| [split(command), vec![format!("{option}={number}")]].concat();
        lines.extend(NUMBERS.iter().map(with));
    }
    for file in bad_files(folder) {
        lines.extend(READERS.iter().map(|line| split(&line.replace("{}", &file))));
    }
    let mut table = "| command | exit code | what it said first |\n| --- | --- | --- |\n".to_owned();
    let mut fine = Vec::new();
    for words in &lines {
        let _ = fs::remove_dir_all(folder.join("out"));
        let needs_out = ["map", "replay", "localize", "cloud"].contains(&words.first().map_or("", String::as_str))
            && !words.iter().any(|word| word == "--out");
        let mut all: Vec<&str> = words.iter().map(String::as_str).collect();
        if needs_out {
            all.extend(["--out", "out"]);
        }
        let (code, said) = got(folder, &all);
        let first = said.lines().next().unwrap_or_default().replace('|', "/");
        writeln!(table, "| `{}` | {code} | {first} |", words.join(" ")).unwrap();
        if code == 0 {
            fine.push(words.join(" "));
        } else {
            assert!([1, 2, 3].contains(&code) && !said.is_empty(), "{words:?}: {code} {said}");
        }
    }
    let place = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bad-inputs.md");
    fs::write(place, &table).unwrap();
    assert!(lines.len() >= 200, "{}", lines.len());
    println!("{} bad inputs; {} of them did no harm:\n{}", lines.len(), fine.len(), fine.join("\n"));
    assert!(fine.len() < lines.len() / 8, "{fine:#?}");
}
