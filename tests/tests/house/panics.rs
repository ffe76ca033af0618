//! Panics that the microcontroller's image can still reach, seen in its machine code: each caller is listed in `firmware-sim/firmware/panics.txt` with the
//! reason why it never gets there. A new one fails here. It needs the image (`firmware-sim/firmware/build`) and its place in LRFSLAM_FIRMWARE.

use std::collections::BTreeMap;

use super::root;

/// The image that is looked at.
const IMAGE: &str = "mps2-an386";

/// A function of an image: its code and its name.
struct Function<'a> {
    address: u32,
    code: &'a [u8],
    name: String,
}

fn half(bytes: &[u8], at: usize) -> u32 {
    u32::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()))
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Functions of a 32-bit little-endian ELF file, by address; of several with one body, one.
fn functions(image: &[u8]) -> Vec<Function<'_>> {
    assert_eq!(&image[..6], b"\x7fELF\x01\x01");
    let sections = word(image, 32) as usize;
    // Of a section header: 4 kind, 12 address, 16 place in the file, 20 size, 24 link.
    let header = |index: u32, field: usize| word(image, sections + 40 * index as usize + field) as usize;
    let symbols = (0..half(image, 48)).find(|index| header(*index, 4) == 2).expect("symbols");
    let names = header(symbols, 24) as u32;
    let mut found: Vec<Function<'_>> = (0..header(symbols, 20) / 16)
        .map(|index| header(symbols, 16) + 16 * index)
        .filter(|at| image[at + 12] & 15 == 2 && word(image, at + 8) > 0)
        .map(|at| {
            let address = word(image, at + 4) & !1;
            let section = half(image, at + 14);
            let start = header(section, 16) + address as usize - header(section, 12);
            let name = &image[header(names, 16) + word(image, at) as usize..];
            let end = name.iter().position(|byte| *byte == 0).unwrap();
            let code = &image[start..start + word(image, at + 8) as usize];
            Function { address, code, name: readable(std::str::from_utf8(&name[..end]).unwrap()) }
        })
        .collect();
    found.sort_by(|one, other| (one.address, &one.name).cmp(&(other.address, &other.name)));
    found.dedup_by_key(|function| function.address);
    found
}

/// Where the 32-bit branches of a function lead (B.W and BL, encodings T4 and T1 of the ARMv7-M manual, A7.7.12 and A7.7.18).
fn branches(function: &Function<'_>) -> Vec<u32> {
    let mut targets = Vec::new();
    let mut at = 0;
    while at + 4 <= function.code.len() {
        let (first, second) = (half(function.code, at), half(function.code, at + 2));
        if first >> 11 < 0b11101 {
            at += 2;
            continue;
        }
        if first >> 11 == 0b11110 && second & 0x9000 == 0x9000 {
            let sign = first >> 10 & 1;
            let [i1, i2] = [13, 11].map(|bit| 1 ^ (second >> bit & 1) ^ sign);
            let offset = sign << 24 | i1 << 23 | i2 << 22 | (first & 0x3ff) << 12 | (second & 0x7ff) << 1;
            let offset = ((offset << 7) as i32 >> 7) as u32;
            targets.push((function.address + at as u32 + 4).wrapping_add(offset));
        }
        at += 4;
    }
    targets
}

/// A symbol's path, in either form that the compiler has, without what differs from build to build.
fn readable(symbol: &str) -> String {
    let mut parts = Vec::new();
    let (is_new, mut rest) = match (symbol.strip_prefix("_ZN"), symbol.strip_prefix("_R")) {
        (Some(rest), _) => (false, rest),
        (_, Some(rest)) => (true, rest),
        _ => return symbol.to_owned(),
    };
    while let Some(letter) = rest.chars().next() {
        if letter.is_ascii_digit() {
            let end = rest.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len());
            let text = rest[end..].strip_prefix('_').filter(|_| is_new).unwrap_or(&rest[end..]);
            let (part, after) = text.split_at(rest[..end].parse::<usize>().unwrap().min(text.len()));
            parts.push(part);
            rest = after;
        } else if is_new && (letter == 's' || letter == 'B') {
            rest = rest.split_once('_').map_or("", |(_, after)| after);
        } else {
            rest = &rest[1..];
        }
    }
    if !is_new {
        parts.pop();
    }
    let marks =
        [("$LT$", "<"), ("$GT$", ">"), ("$u20$", " "), ("$u7b$", "{"), ("$u7d$", "}"), ("$RF$", "&"), ("..", "::")];
    let text = marks.iter().fold(parts.join("::"), |text, (mark, plain)| text.replace(mark, plain));
    text.trim_start_matches('_').to_owned()
}

/// What ends in the panic handler and does nothing else.
fn is_panic(name: &str) -> bool {
    let last = name.rsplit("::").next().unwrap_or_default();
    name.starts_with("core::") && (name.contains("::panicking::") || last.contains("panic") || last.contains("fail"))
}

/// How often each function of `image` goes to a panic.
fn sites(image: &[u8]) -> BTreeMap<String, usize> {
    let functions = functions(image);
    let panics: Vec<u32> =
        functions.iter().filter(|function| is_panic(&function.name)).map(|function| function.address).collect();
    assert!(functions.len() > 50 && !panics.is_empty(), "{} functions, {} panics", functions.len(), panics.len());
    let mut sites = BTreeMap::new();
    for function in functions.iter().filter(|function| !is_panic(&function.name)) {
        let count = branches(function).iter().filter(|target| panics.contains(target)).count();
        if count > 0 {
            *sites.entry(function.name.clone()).or_insert(0) += count;
        }
    }
    sites
}

#[test]
fn every_panic_of_the_image_is_known_to_be_out_of_reach() {
    let Some(folder) = std::env::var_os("LRFSLAM_FIRMWARE") else {
        println!("skipped: panics of the firmware: no LRFSLAM_FIRMWARE (firmware-sim/firmware/build)");
        return;
    };
    let image = std::fs::read(std::path::Path::new(&folder).join(IMAGE)).unwrap();
    let list = std::fs::read_to_string(root().join("firmware-sim/firmware/panics.txt")).unwrap();
    let compiler = list.lines().find_map(|line| line.strip_prefix("# Compiler: ")).unwrap();
    let found = sites(&image);
    println!("{} places in {} functions of {IMAGE} go to a panic", found.values().sum::<usize>(), found.len());
    if !image.windows(compiler.len()).any(|bytes| bytes == compiler.as_bytes()) {
        println!("skipped: panics of the firmware are listed for {compiler}; another compiler leaves others");
        return;
    }
    let mut known = BTreeMap::new();
    for line in list.lines().filter(|line| !line.starts_with('#') && !line.is_empty()) {
        let (count, rest) = line.split_once(' ').unwrap();
        let (name, why) = rest.split_once(": ").unwrap_or_else(|| panic!("no reason: {line}"));
        assert!(why.len() > 20, "no reason: {line}");
        known.insert(name.to_owned(), count.parse::<usize>().unwrap());
    }
    assert_eq!(found, known, "left: the image; right: firmware-sim/firmware/panics.txt");
}

#[test]
fn branches_and_names_are_read() {
    // BL from 0x1000 to 0x1004 + 0x100, NOP, B.W back to 0x1000.
    let code = [0x00, 0xf0, 0x80, 0xf8, 0x00, 0xbf, 0xff, 0xf7, 0xfb, 0xbf];
    let function = Function { address: 0x1000, code: &code, name: String::new() };
    assert_eq!(branches(&function), [0x1104, 0x1000]);
    assert_eq!(
        readable("_ZN13lrfslam_robot7program7machine9tell_path17h64733d6ed99d9ed8E"),
        "lrfslam_robot::program::machine::tell_path"
    );
    assert_eq!(
        readable("_RNvNtCs7ldSeZOOJos_4core9panicking18panic_bounds_check"),
        "core::panicking::panic_bounds_check"
    );
    assert_eq!(
        readable("_RNvMsu_NtNtCs7ldSeZOOJos_4core3str7patternNtB5_11StrSearcher3new"),
        "core::str::pattern::StrSearcher::new"
    );
    assert!(is_panic("core::slice::index::slice_index_fail") && !is_panic("core::slice::memchr::memrchr"));
}
