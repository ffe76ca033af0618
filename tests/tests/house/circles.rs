//! Modules of a package use one another in one direction: between the parts of a folder, a folder among them stands in no circle.
//!
//! Paths are read from the text, without its tests and comments: `crate::…`, `self::…` and `super::…`, also in braces. A module and what it
//! consists of are one to the outside; files side by side in a folder may know each other.

use std::collections::{BTreeMap, BTreeSet};

use super::{files, root};

const PACKAGES: [&str; 10] = [
    "core",
    "core/lrf",
    "core/robot",
    "core/scan",
    "host",
    "host/app",
    "host/lab",
    "host/monitor",
    "host/ros2",
    "firmware-sim",
];

/// A module by its path, such as `["wire", "session"]`; the crate's root has none.
type Module = Vec<String>;
/// What each module uses.
type Uses = BTreeMap<Module, BTreeSet<Module>>;

#[test]
fn no_circle_goes_through_a_folder() {
    let mut circles = Vec::new();
    for package in PACKAGES {
        let sources = sources(package);
        assert!(!sources.is_empty(), "{package} has no source");
        circles.extend(circles_of(&uses(&sources)).into_iter().map(|circle| format!("{package}: {circle}")));
    }
    assert!(circles.is_empty(), "{circles:#?}");
}

#[test]
fn a_circle_is_found() {
    let text = |path: &[&str], text: &str| (path.iter().map(|part| (*part).to_owned()).collect(), text.to_owned());
    let sources = |maps: &str| {
        BTreeMap::from([
            text(&["maps"], ""),
            text(&["maps", "picture"], maps),
            text(&["runs"], "use crate::maps::picture::draw;\nuse crate::{maps, config};"),
        ])
    };
    assert_eq!(circles_of(&uses(&sources("// crate::runs"))), Vec::<String>::new());
    assert_eq!(circles_of(&uses(&sources("use super::super::runs::Run;"))), ["maps, runs"]);
    assert_eq!(circles_of(&uses(&sources("use crate::{config, runs};"))), ["maps, runs"]);
}

/// The text of every module of a package.
fn sources(package: &str) -> BTreeMap<Module, String> {
    let folder = root().join(package).join("src");
    let mut sources = BTreeMap::new();
    for file in files(&folder, "rs") {
        let mut path: Module =
            file.with_extension("").components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect();
        if path.last().is_some_and(|name| ["mod", "lib", "main"].contains(&name.as_str())) {
            path.pop();
        }
        if path.last().is_some_and(|name| name == "tests") {
            continue;
        }
        let text: String = sources.remove(&path).unwrap_or_default();
        sources.insert(path, text + &std::fs::read_to_string(folder.join(&file)).unwrap());
    }
    sources
}

fn uses(sources: &BTreeMap<Module, String>) -> Uses {
    let known: BTreeSet<&Module> = sources.keys().collect();
    let mut uses = Uses::new();
    for (module, text) in sources {
        for path in paths(&code(text)) {
            // The longest part of a path that names a module is what is used.
            let full = absolute(module, &path);
            let used = (1..=full.len()).rev().map(|parts| full[..parts].to_vec()).find(|used| known.contains(used));
            uses.entry(module.clone()).or_default().extend(used.filter(|used| used != module));
        }
    }
    uses
}

/// `text` without comments, and without its tests, which stand at its end.
fn code(text: &str) -> String {
    let end = text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len());
    text[..end].lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// All paths in `code` that begin in this package, those in braces one by one.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for start in ["crate::", "self::", "super::"] {
        for (at, _) in code.match_indices(start) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|before| before.is_alphanumeric() || before == '_' || before == ':' || before == '$')
            {
                continue;
            }
            expand(&mut Vec::new(), &code[at..], &mut found);
        }
    }
    found
}

/// Reads the path at the start of `text` behind `stem`, and returns what is left of `text`.
fn expand<'t>(stem: &mut Vec<String>, text: &'t str, found: &mut Vec<Vec<String>>) -> &'t str {
    let text = text.trim_start();
    if let Some(mut rest) = text.strip_prefix('{') {
        loop {
            rest = expand(stem, rest, found).trim_start();
            match rest.strip_prefix(',') {
                Some(next) => rest = next,
                None => return rest.strip_prefix('}').unwrap_or(""),
            }
        }
    }
    let end = text.find(|letter: char| !letter.is_alphanumeric() && letter != '_').unwrap_or(text.len());
    stem.push(text[..end].to_owned());
    let rest = match text[end..].strip_prefix("::") {
        Some(next) => expand(stem, next, found),
        None => {
            found.push(stem.clone());
            text[end..].trim_start_matches(|letter: char| !",}".contains(letter))
        }
    };
    stem.pop();
    rest
}

fn absolute(module: &Module, path: &[String]) -> Module {
    let mut full = if path[0] == "crate" { Vec::new() } else { module.clone() };
    for part in path {
        match part.as_str() {
            "crate" | "self" => {}
            "super" => drop(full.pop()),
            _ => full.push(part.clone()),
        }
    }
    full
}

/// The parts of one folder that use each other in a circle, where one of them is a folder.
fn circles_of(uses: &Uses) -> Vec<String> {
    let modules: BTreeSet<&Module> = uses.keys().chain(uses.values().flatten()).collect();
    let folders: BTreeSet<Module> =
        modules.iter().flat_map(|module| (0..module.len()).map(|parts| module[..parts].to_vec())).collect();
    let mut circles = Vec::new();
    for folder in &folders {
        let part = |module: &Module| module.strip_prefix(folder.as_slice()).and_then(|rest| rest.first().cloned());
        let mut between: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for (user, used) in uses.iter().flat_map(|(user, used)| used.iter().map(move |used| (user, used))) {
            if let (Some(user), Some(used)) = (part(user), part(used)) {
                between.entry(user).or_default().insert(used);
            }
        }
        let reach: BTreeMap<&String, BTreeSet<String>> =
            between.keys().map(|part| (part, reached(part, &between))).collect();
        let mut told = BTreeSet::new();
        for part in between.keys() {
            let circle: Vec<&str> = reach[part]
                .iter()
                .filter(|other| *other != part && reach.get(other).is_some_and(|back| back.contains(part)))
                .chain([part])
                .map(String::as_str)
                .collect::<BTreeSet<_>>()
                .into_iter()
                .collect();
            let is_folder = |name: &&str| folders.contains(&[folder.as_slice(), &[(*name).to_owned()]].concat());
            if circle.len() > 1 && circle.iter().any(is_folder) && told.insert(circle.join(", ")) {
                circles.push([folder.as_slice(), &[circle.join(", ")]].concat().join("::"));
            }
        }
    }
    circles
}

/// All that `part` uses, directly or by others.
fn reached(part: &str, between: &BTreeMap<String, BTreeSet<String>>) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut next = vec![part.to_owned()];
    while let Some(user) = next.pop() {
        for used in between.get(&user).into_iter().flatten().filter(|used| **used != user) {
            if reached.insert(used.clone()) {
                next.push(used.clone());
            }
        }
    }
    reached
}
