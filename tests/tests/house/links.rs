//! Links and pictures of the pages lead somewhere: to a file that is there, and to a heading in it. Those of the book stay in the book.

use std::path::{Path, PathBuf};

use super::{files, root};

#[test]
fn every_link_of_a_page_leads_somewhere() {
    let mut checked = 0;
    let mut dead = Vec::new();
    for page in files(&root(), "md") {
        let text = std::fs::read_to_string(root().join(&page)).unwrap();
        for target in targets(&text) {
            checked += 1;
            if !leads_somewhere(&page, &text, &target) {
                dead.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(checked > 30, "found {checked} links only");
    assert!(dead.is_empty(), "{dead:#?}");
}

/// What is not in the contents is not in the book, nor is what lies beside `docs`: a link to it would be dead there.
#[test]
fn the_book_is_complete_in_itself() {
    let docs = root().join("docs");
    let pages = files(&docs, "md");
    let contents = std::fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    let listed: Vec<PathBuf> = targets(&contents).into_iter().map(PathBuf::from).collect();
    let mut faults = Vec::new();
    for page in pages.iter().filter(|page| *page != Path::new("SUMMARY.md")) {
        if listed.iter().filter(|listed| *listed == page).count() != 1 {
            faults.push(format!("{} is not once in SUMMARY.md", page.display()));
        }
        for target in targets(&std::fs::read_to_string(docs.join(page)).unwrap()) {
            let up = target.matches("../").count();
            if up >= page.components().count() {
                faults.push(format!("{}: {target} is outside of the book", page.display()));
            }
        }
    }
    assert!(listed.len() > 20 && listed.len() + 1 == pages.len(), "{} listed, {} pages", listed.len(), pages.len());
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Targets of inline links within the repository, outside code.
fn targets(text: &str) -> Vec<String> {
    let mut is_code = false;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        }
        // Every second piece between backticks is code.
        for prose in line.split('`').step_by(2).filter(|_| !is_code) {
            for (at, _) in prose.match_indices("](") {
                let target: String = prose[at + 2..].chars().take_while(|letter| *letter != ')').collect();
                if !target.contains("://") && !target.starts_with("mailto:") {
                    found.push(target);
                }
            }
        }
    }
    found
}

fn leads_somewhere(page: &Path, text: &str, target: &str) -> bool {
    let (file, heading) = target.split_once('#').unwrap_or((target, ""));
    let path = root().join(page).parent().unwrap().join(file);
    if file.is_empty() {
        return has_heading(text, heading);
    }
    path.exists() && (heading.is_empty() || std::fs::read_to_string(path).is_ok_and(|text| has_heading(&text, heading)))
}

/// By the rule of those who show the pages: small letters, hyphens for spaces, nothing else.
fn has_heading(text: &str, heading: &str) -> bool {
    let anchor = |title: &str| -> String {
        let kept = title.trim().to_lowercase().replace(' ', "-");
        kept.chars().filter(|letter| letter.is_alphanumeric() || "-_".contains(*letter)).collect()
    };
    text.lines().filter(|line| line.starts_with('#')).any(|line| anchor(line.trim_start_matches('#')) == heading)
}
