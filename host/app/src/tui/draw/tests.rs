use super::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;

/// A hall of 8 × 4 m with a robot in it that looks up.
fn hall() -> Picture {
    let run = |column, row, cells, is_wall| Run { column, row, cells, is_wall };
    let mut runs = vec![run(0, 0, 80, true), run(0, 39, 80, true)];
    for row in 1..39 {
        runs.extend([run(0, row, 1, true), run(1, row, 78, false), run(79, row, 1, true)]);
    }
    let words = vec!["corridor: position along it is a guess".to_owned(), "paused".to_owned()];
    let status = Status {
        words,
        mood: Mood::Doubt,
        pose: Some([6.0, 2.0, 1.6]),
        what: "map".to_owned(),
        source: "hall.log".to_owned(),
        scans: 42,
        way_m: 5.04,
        can_pause: true,
        news: vec!["laser found\u{1b}[2J".to_owned()],
        ..Status::default()
    };
    let tiles = [((0, 0, 0), runs)].into();
    let path = (0..50).map(|step| [1.0 + 0.1 * step as f32, 2.0]).collect();
    Picture { cell_m: 0.1, tiles, path, hits: vec![([4.0, 3.0], true)], status, ..Picture::default() }
}

fn screen(width: u16, height: u16, picture: &Picture, view: &mut View) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, picture, view)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>().trim_end().to_owned();
    (0..height).map(row).collect()
}

#[test]
fn a_hall_is_seen_with_words_numbers_and_keys() {
    let rows = screen(80, 24, &hall(), &mut View::default());
    let text = rows.join("\n");
    assert_eq!(rows[0], "▲ corridor: position along it is a guess");
    assert_eq!(rows[1], "paused · map hall.log");
    assert!(rows[23].starts_with("q stop · s save · p pause · f follow"), "{text}");
    for wanted in
        ["position       6.00, 2.00 m", "way            5.0 m", "scans          42", "┤ 2 m", "laser found?[2J"]
    {
        assert!(text.contains(wanted), "{wanted}\n{text}");
    }
    // The walls all around, free within, the path up to the robot.
    let (first, last) = (2, 19);
    let has_braille = |row: &String| row.chars().filter(|letter| ('⠁'..='⣿').contains(letter)).count();
    let walls: Vec<usize> = (first..=last).filter(|row| has_braille(&rows[*row]) > 30).collect();
    // A wall may lie on the edge of two rows.
    assert!((2..=4).contains(&walls.len()), "{text}");
    let robot = rows.iter().position(|row| row.contains('↑')).unwrap();
    assert!(walls[0] < robot && robot < walls[walls.len() - 1] && has_braille(&rows[robot]) > 15, "{text}");
    assert!(rows[robot - 1].contains("····"), "{text}");
}

#[test]
fn a_small_screen_and_an_empty_run_are_drawn_too() {
    for (width, height) in [(1, 1), (20, 4), (30, 8), (71, 15), (300, 100)] {
        for picture in [Picture::default(), hall()] {
            let mut view = View::default();
            let rows = screen(width, height, &picture, &mut view);
            assert_eq!(rows.len(), usize::from(height));
            view.follow();
            view.zoom(1e9);
            screen(width, height, &picture, &mut view);
            view.zoom(1e-9);
            screen(width, height, &picture, &mut view);
        }
    }
}
