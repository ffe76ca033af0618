//! A table of bad inputs across every command and both links, and what each got: an end within seconds, an exit code that says so, and words that
//! name the option or the file; never a panic. The table is `docs/reference/bad-inputs.md`. Where words change,
//! `LRFSLAM_RENEW_GOLDEN=1 cargo test -p lrfslam --all-features --test cli bad_table` writes it anew.

mod rows;

use std::fmt::Write as _;
use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::{flaser, lrfslam, run};
use rows::{LINES, LINKS, NUMBERS, OPTIONS, PEERS, PORTS, READERS};

const PAGE: &str = "# Bad inputs\n\nWhat `lrfslam` makes of input that is wrong: the command, its exit code, and what it says first. A test runs every line of \
this page, and compares.\nFiles named `ok` are what they should be. The others are cut, flipped, empty, noise, or of another kind; `.d` is a folder with such a file in it. \
[Exit codes](commands.md#exit-codes) are those of every command.\n";

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
    names.extend(["nowhere", "/dev/null", "map"].map(str::to_owned));
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

/// The words of a command line.
fn split(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

/// A command line, and a word that must be in what it says.
type Row = (Vec<String>, String);

/// The sections of the table that need no link.
fn sections(folder: &Path) -> Vec<(&'static str, Vec<Row>)> {
    let options = OPTIONS.iter().flat_map(|(command, option)| {
        NUMBERS.map(|number| ([split(command), vec![format!("{option}={number}")]].concat(), (*option).to_owned()))
    });
    let files = bad_files(folder).into_iter().flat_map(|file| {
        // The map itself is no bad one.
        let readers =
            READERS.iter().filter(|line| file != "map" || !line.contains("--continue") && !line.contains("--map"));
        let lines: Vec<Row> = readers.map(|line| (split(&line.replace("{}", &file)), file.clone())).collect();
        lines
    });
    let lines = LINES.iter().map(|line| (split(line), String::new()));
    vec![("Lines", lines.collect()), ("Numbers", options.collect()), ("Files", files.collect())]
}

/// What a command says, up to the first empty line, on one line; free memory is another on every computer.
fn first_words(said: &str) -> String {
    let paragraph = said.trim_start().split("\n\n").next().unwrap_or_default();
    let mut words: Vec<&str> = paragraph.split_whitespace().collect();
    for at in 1..words.len() {
        if words[at..].starts_with(&["GB", "are"]) {
            words[at - 1] = "…";
        }
    }
    let text = words.join(" ").replace('|', "/").replace('`', "'");
    let short: String = text.chars().take(180).collect();
    let short = if short.len() < text.len() { short + "…" } else { short };
    // A page of the book takes what stands in angles for HTML.
    short.replace('<', "\\<")
}

/// Runs a line, with a place for its results if it takes one: exit code and all that it said.
fn tried(folder: &Path, words: &[String]) -> (i32, String) {
    let _ = fs::remove_dir_all(folder.join("out"));
    let _ = fs::remove_file(folder.join("made.toml"));
    let mut all: Vec<&str> = words.iter().map(String::as_str).collect();
    let command = all.first().copied().unwrap_or_default();
    let has = |name: &str| words.iter().any(|word| word.starts_with(name));
    if ["map", "replay", "localize", "cloud", "demo"].contains(&command) && !has("--out")
        || command == "landmarks" && has("--data") && !has("--out") && !has("--seeds")
    {
        all.extend(["--out", "out"]);
    }
    if command == "calibrate" && all.len() > 1 && !has("--out") {
        all.extend(["--out", "made.toml"]);
    }
    got(folder, &all)
}

/// Serves every connection as this kind of peer does: its port.
fn peer(kind: &'static str) -> u16 {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let serve = move |mut line: TcpStream| -> std::io::Result<()> {
        let noise: Vec<u8> = (0..4096_u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 21) as u8).collect();
        match kind {
            "closes" => return Ok(()),
            "sends zeros" => (0..2000).try_for_each(|_| paced(&mut line, &[0; 4096])),
            "sends noise" => (0..2000).try_for_each(|_| paced(&mut line, &noise)),
            "speaks HTTP" => line.write_all(b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n"),
            _ => Ok(()),
        }?;
        while line.read(&mut [0; 4096])? > 0 {}
        Ok(())
    };
    std::thread::spawn(move || {
        for line in listener.incoming().map_while(Result::ok) {
            std::thread::spawn(move || serve(line));
        }
    });
    port
}

/// 400 kB a second: more than any laser sends.
fn paced(line: &mut TcpStream, bytes: &[u8]) -> std::io::Result<()> {
    std::thread::sleep(Duration::from_millis(10));
    line.write_all(bytes)
}

/// Lines with a link, all at once, since each waits for ten seconds: the line as it is shown, and its exit code.
fn links(folder: &Path) -> Vec<(String, i32)> {
    let peers = LINKS.iter().flat_map(|line| PEERS.map(|kind| (line, format!("tcp:127.0.0.1:{}", peer(kind)), kind)));
    let mut lines: Vec<(String, String, String)> = peers
        .map(|(line, port, kind)| {
            (line.replace("{}", &port), format!("{} (which {kind})", line.replace("{}", "tcp:…")), port)
        })
        .collect();
    lines.extend(PORTS.map(|line| (line.to_owned(), line.to_owned(), String::new())));
    let run = |at: usize, line: &str, port: &str| {
        let own = folder.join(format!("link-{at}"));
        fs::create_dir(&own).unwrap();
        fs::copy(folder.join("ok.log"), own.join("ok.log")).unwrap();
        let words = split(line);
        let (code, said) = got(&own, &words.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(said.contains(port), "{line}: {code} {said}");
        code
    };
    std::thread::scope(|scope| {
        let started: Vec<_> = lines
            .iter()
            .enumerate()
            .map(|(at, (line, shown, port))| (shown, scope.spawn(move || run(at, line, port))))
            .collect();
        started.into_iter().map(|(shown, line)| (shown.clone(), line.join().expect("no panic"))).collect()
    })
}

#[test]
fn bad_inputs_across_every_command_get_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare(folder);
    let mut page = PAGE.to_owned();
    let (mut count, mut fine, mut unnamed) = (0, Vec::new(), Vec::new());
    for (title, rows) in sections(folder) {
        write!(page, "\n## {title}\n\n| command | exit code | what it says first |\n| --- | --- | --- |\n").unwrap();
        for (words, named) in rows {
            let (code, said) = tried(folder, &words);
            writeln!(page, "| `{}` | {code} | {} |", words.join(" "), first_words(&said)).unwrap();
            count += 1;
            if code == 0 {
                fine.push(words.join(" "));
                continue;
            }
            assert!([1, 2, 3].contains(&code) && !said.is_empty(), "{words:?}: {code} {said}");
            // `calibrate` tells of two files together.
            if code != 3 && words.first().is_none_or(|command| command != "calibrate") && !said.contains(&named) {
                unnamed.push(format!("{words:?} does not name {named}: {said}"));
            }
        }
    }
    page += "\n## Links\n\nEach ends by itself, and names its port.\n\n| command | exit code |\n| --- | --- |\n";
    for (line, code) in links(folder) {
        assert_eq!(code, 1, "{line}");
        writeln!(page, "| `{line}` | {code} |").unwrap();
        count += 1;
    }
    assert!(unnamed.is_empty(), "{unnamed:#?}");
    println!("{count} bad inputs; {} of them did no harm:\n{}", fine.len(), fine.join("\n"));
    assert!(count >= 400 && fine.len() < count / 10, "{count}: {fine:#?}");
    compare(&page);
}

/// With the page as it is kept; what few builds lack has other rows.
fn compare(page: &str) {
    if !cfg!(all(feature = "demo", feature = "experiments", feature = "monitor")) {
        println!("skipped: docs/reference/bad-inputs.md is compared with all features only");
        return;
    }
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/bad-inputs.md");
    if std::env::var_os("LRFSLAM_RENEW_GOLDEN").is_some() {
        fs::write(&kept, page).unwrap();
    }
    let kept = fs::read_to_string(kept).unwrap_or_default();
    let other: Vec<&str> = page.lines().filter(|line| !kept.lines().any(|kept| kept == *line)).collect();
    assert!(page == kept, "not in docs/reference/bad-inputs.md (LRFSLAM_RENEW_GOLDEN=1 writes it): {other:#?}");
}
