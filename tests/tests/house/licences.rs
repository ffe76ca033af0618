//! What is linked has a licence that `deny.toml` allows, and comes from crates.io. It is what `cargo deny check licenses sources` asks,
//! without a program to install. Security advisories are not asked for: they are a database to download.

use std::collections::BTreeSet;
use std::process::Command;

use serde_json::Value;

use super::root;

const CRATES_IO: &str = "registry+https://github.com/rust-lang/crates.io-index";

#[test]
fn every_package_has_a_licence_that_is_allowed() {
    let rules: toml::Table = std::fs::read_to_string(root().join("deny.toml")).unwrap().parse().unwrap();
    let allowed: BTreeSet<String> = rules["licenses"]["allow"].clone().try_into().unwrap();
    let mut needed = BTreeSet::new();
    let mut faults = Vec::new();
    let mut all_known = true;
    for (workspace, least) in [(".", 150), ("firmware-sim/firmware", 40)] {
        let Some(packages) = packages(workspace) else {
            println!("skipped: licences of {workspace} (cargo fetch --locked there downloads what they are read from)");
            all_known = false;
            continue;
        };
        assert!(packages.len() > least, "{workspace}: {} packages only", packages.len());
        for package in packages {
            let name = format!("{} {}", text(&package["name"]), text(&package["version"]));
            let licence = text(&package["license"]);
            match kept(licence, &allowed) {
                Some(of_it) => needed.extend(of_it),
                None => faults.push(format!("{name}: `{licence}` is not allowed by deny.toml")),
            }
            if !package["source"].is_null() && package["source"] != CRATES_IO {
                faults.push(format!("{name}: comes from {}", package["source"]));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
    let idle: Vec<&String> = allowed.difference(&needed).collect();
    assert!(idle.is_empty() || !all_known, "deny.toml allows what no package needs: {idle:?}");
}

#[test]
fn expressions_of_licences_are_read() {
    let allowed: BTreeSet<String> = ["MIT", "Zlib"].map(str::to_owned).into();
    let good = ["MIT", "Zlib/GPL-3.0-only", "GPL-3.0-only OR (MIT AND Zlib)", "(MIT OR Apache-2.0) AND Zlib"];
    let bad = [
        "",
        "GPL-3.0-only",
        "MIT AND GPL-3.0-only",
        "MIT WITH Nonsense",
        "(MIT OR Zlib) AND (GPL-2.0 OR BSL-1.0)",
        "MIT OR",
        "MIT)",
    ];
    good.iter().for_each(|licence| assert!(kept(licence, &allowed).is_some(), "{licence}"));
    bad.iter().for_each(|licence| assert!(kept(licence, &allowed).is_none(), "{licence}"));
}

/// Packages of a workspace for every target; for this one alone where the others are not downloaded, which is said; None if it is not.
fn packages(workspace: &str) -> Option<Vec<Value>> {
    let host = Command::new("rustc").args(["--print", "host-tuple"]).output().unwrap();
    let host = String::from_utf8(host.stdout).unwrap();
    let ask = |more: &[&str]| {
        let metadata = ["metadata", "--format-version", "1", "--locked", "--offline", "--all-features"];
        let mut cargo = Command::new(env!("CARGO"));
        let output = cargo.args(metadata).args(more).current_dir(root().join(workspace)).output().unwrap();
        output.status.success().then_some(output.stdout)
    };
    let listed = ask(&[]).or_else(|| {
        println!(
            "skipped: licences of what only other computers need in {workspace} (cargo fetch --locked downloads it)"
        );
        ask(&["--filter-platform", host.trim()])
    });
    let listed: Value = serde_json::from_slice(&listed?).unwrap();
    Some(listed["packages"].as_array().unwrap().clone())
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// Which of the allowed licences are kept by taking what this SPDX expression offers; None if that is not possible. `/` is an old `OR`.
fn kept(expression: &str, allowed: &BTreeSet<String>) -> Option<BTreeSet<String>> {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let mut words = spaced.split_whitespace().peekable();
    let kept = any(&mut words, allowed)?;
    words.next().is_none().then_some(kept).flatten()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;
/// The outer one is None for what is not an expression, the inner for what is not allowed.
type Kept = Option<Option<BTreeSet<String>>>;

/// Alternatives: of those that are allowed, the first.
fn any(words: &mut Words<'_>, allowed: &BTreeSet<String>) -> Kept {
    let mut found = all(words, allowed)?;
    while words.next_if_eq(&"OR").is_some() {
        let other = all(words, allowed)?;
        found = found.or(other);
    }
    Some(found)
}

/// What must be kept together.
fn all(words: &mut Words<'_>, allowed: &BTreeSet<String>) -> Kept {
    let mut found = one(words, allowed)?;
    while words.next_if_eq(&"AND").is_some() {
        let other = one(words, allowed)?;
        found = found.zip(other).map(|(one, other)| &one | &other);
    }
    Some(found)
}

fn one(words: &mut Words<'_>, allowed: &BTreeSet<String>) -> Kept {
    let word = words.next()?;
    if word == "(" {
        let inner = any(words, allowed)?;
        return words.next_if_eq(&")").map(|_| inner);
    }
    let mut licence = word.to_owned();
    if words.next_if_eq(&"WITH").is_some() {
        licence = format!("{licence} WITH {}", words.next()?);
    }
    Some(allowed.contains(&licence).then(|| BTreeSet::from([licence])))
}
