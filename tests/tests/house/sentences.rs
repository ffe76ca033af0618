//! Sentences of the book that one can read at a breath. What a command writes, [`measured.md`](../../../docs/measured.md), is left out.

use super::{files, root};

const WORDS_MAX: usize = 30;

#[test]
fn no_sentence_of_the_book_is_longer_than_a_breath() {
    let docs = root().join("docs");
    let mut checked = 0;
    let mut long = Vec::new();
    for page in files(&docs, "md").into_iter().filter(|page| !page.ends_with("measured.md")) {
        for sentence in sentences(&std::fs::read_to_string(docs.join(&page)).unwrap()) {
            checked += 1;
            let words = words(&sentence);
            if words > WORDS_MAX {
                long.push(format!("{}: {words} words: {sentence}", page.display()));
            }
        }
    }
    assert!(checked > 500, "found {checked} sentences only");
    assert!(long.is_empty(), "over {WORDS_MAX} words: {long:#?}");
}

#[test]
fn sentences_are_told_apart() {
    let text = "# A title\n\nOne `a. b c` two. Three\nfour: five\n- six\n- seven\n\n```sh\ncode. code\n```\n| cell. cell |\n    more code\n";
    assert_eq!(sentences(text), ["One ` ` two.", "Three four:", "five", "- six", "- seven"]);
    assert_eq!(words("- a [b c](d-e.md) – f"), 4);
}

/// Those of the running text, with what stands between backticks left out: not headings, tables and code.
fn sentences(page: &str) -> Vec<String> {
    let mut is_code = false;
    let mut paragraphs = vec![String::new()];
    for line in page.lines() {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        let text = line.trim();
        let item = text
            .split_once(' ')
            .is_some_and(|(mark, _)| mark == "-" || mark.trim_end_matches('.').parse::<u8>().is_ok());
        let other = is_code || is_fence || line.starts_with("    ") || text.starts_with(['|', '#']);
        if other || item || text.is_empty() {
            paragraphs.push(String::new());
        }
        if let Some(paragraph) = paragraphs.last_mut().filter(|_| !other && !text.is_empty()) {
            *paragraph = [paragraph, text].join(" ").trim().to_owned();
        }
    }
    let without_code = |text: &String| text.split('`').step_by(2).collect::<Vec<_>>().join("` `");
    paragraphs.iter().map(without_code).flat_map(|paragraph| split(&paragraph)).collect()
}

fn split(paragraph: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    for word in paragraph.split_whitespace() {
        let sentence = found.last_mut().expect("there is one");
        *sentence = [sentence.as_str(), word].join(" ").trim().to_owned();
        let mark = word.parse::<f32>().is_ok();
        if !mark && word.trim_end_matches(['*', ')']).ends_with(['.', ':', ';', '?', '!']) {
            found.push(String::new());
        }
    }
    found.retain(|sentence| !sentence.is_empty());
    found
}

/// Words with a letter or digit in them; the target of a link is none.
fn words(sentence: &str) -> usize {
    let text: String = sentence
        .split("](")
        .enumerate()
        .map(|(at, piece)| if at == 0 { piece } else { piece.split_once(')').map_or("", |(_, rest)| rest) })
        .collect();
    text.split_whitespace().filter(|word| word.contains(char::is_alphanumeric)).count()
}
