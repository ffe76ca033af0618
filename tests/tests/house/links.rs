//! Links of the pages lead somewhere: to a file that is there, and to a heading in it.

use std::path::Path;

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
