//! The screen: words, map, numbers, what the run said, and the keys.

use lrfslam_host::monitor::Status;
use lrfslam_host::monitor::words::Mood;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Wrap};

use super::canvas::{Canvas, Ink};
use super::picture::{Picture, Run};
use super::view::View;

/// Width of the numbers, and of a screen that has room for them.
const NUMBERS: u16 = 34;
const WIDE: u16 = 72;
/// Lines of what the run said, on a screen that has room for them.
const NEWS: u16 = 3;
const HIGH: u16 = 16;
/// Dots of the longest scale.
const SCALE: i32 = 40;
/// The robot, by eighths of a turn from the right on.
const ARROWS: [char; 8] = ['→', '↗', '↑', '↖', '←', '↙', '↓', '↘'];

/// Draws all of it; `view` learns how large the picture is.
pub(super) fn draw(frame: &mut Frame<'_>, picture: &Picture, view: &mut View) {
    let status = &picture.status;
    let news = if frame.area().height >= HIGH { NEWS } else { 0 };
    let rows = [Constraint::Length(2), Constraint::Min(1), Constraint::Length(news), Constraint::Length(1)];
    let [words, middle, said, keys] = Layout::vertical(rows).areas(frame.area());
    frame.render_widget(Paragraph::new(in_words(status)), words);
    let side = if frame.area().width >= WIDE { NUMBERS } else { 0 };
    let [map, numbers] = Layout::horizontal([Constraint::Min(1), Constraint::Length(side)]).areas(middle);
    draw_map(frame, map, picture, view);
    let rows = numbers_of(status).into_iter().map(|(what, value)| {
        let what = Span::styled(format!("  {what:<15}"), Style::new().fg(Color::DarkGray));
        Line::from(vec![what, Span::raw(value)])
    });
    frame.render_widget(Paragraph::new(rows.collect::<Vec<_>>()), numbers);
    let lines = status.news.iter().take(usize::from(news)).rev().map(|text| Line::from(clean(text)));
    let dim = Style::new().fg(Color::DarkGray);
    frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()).style(dim).wrap(Wrap { trim: true }), said);
    let help = if view.notice.is_empty() { keys_of(status) } else { view.notice.to_owned() };
    frame.render_widget(Paragraph::new(help).style(Style::new().add_modifier(Modifier::REVERSED)), keys);
}

/// A terminal does what control characters say, and these words may be a robot's.
fn clean(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { '?' } else { letter }).collect()
}

/// What matters most with a sign of how good it is, and the rest in a second line.
fn in_words(status: &Status) -> Vec<Line<'static>> {
    let (sign, colour) = match status.mood {
        Mood::Good => ("●", Color::Green),
        Mood::Doubt => ("▲", Color::Yellow),
        Mood::Bad => ("■", Color::Red),
    };
    let first = status.words.first().map_or("connecting", String::as_str);
    let bold = Style::new().add_modifier(Modifier::BOLD);
    let rest = status.words.iter().skip(1).cloned().chain([format!("{} {}", status.what, status.source)]);
    vec![
        Line::from(vec![Span::styled(format!("{sign} "), bold.fg(colour)), Span::styled(clean(first), bold)]),
        Line::from(clean(&rest.collect::<Vec<_>>().join(" · "))).style(Style::new().fg(Color::DarkGray)),
    ]
}

/// The numbers of the live page, in its words.
fn numbers_of(status: &Status) -> Vec<(&'static str, String)> {
    let mut rows = Vec::new();
    if let Some([x, y, heading]) = status.pose {
        let [xx, _, yy, _] = status.covariance;
        rows.push(("position", format!("{x:.2}, {y:.2} m")));
        rows.push(("heading", format!("{:.1} °", heading.to_degrees())));
        rows.push(("give or take", format!("{:.0} mm", 1e3 * (xx + yy).max(0.0).sqrt())));
    }
    rows.extend(status.certainty.map(|sure| ("sure", format!("{:.0} %", 100.0 * sure))));
    rows.push(("way", format!("{:.1} m", status.way_m)));
    rows.push(("scans", status.scans.to_string()));
    rows.push(("of them lost", status.lost_scans.to_string()));
    rows.push(("loops closed", status.closures.to_string()));
    if status.pieces_apart > 0 {
        rows.push(("pieces apart", status.pieces_apart.to_string()));
    }
    if let Some(rates) = status.rates {
        rows.push(("scans a second", format!("{:.1}", rates.scans_hz)));
        rows.push(("time for one", format!("{:.0} ms", rates.step_ms)));
        rows.push(("memory", format!("{:.0} MB", rates.memory_mb)));
    }
    if let Some([damaged, restarts, missed]) = status.health {
        let counts = [("damaged", damaged), ("laser restarts", restarts), ("scans missed", missed)];
        rows.extend(counts.map(|(what, count)| (what, count.to_string())));
    }
    rows
}

fn keys_of(status: &Status) -> String {
    let pause = match (status.can_pause, status.is_paused) {
        (false, _) => "",
        (true, false) => "p pause · ",
        (true, true) => "p go on · ",
    };
    format!("q stop · s save · {pause}f follow · 0 all · + - zoom · arrows pan")
}

fn draw_map(frame: &mut Frame<'_>, area: Rect, picture: &Picture, view: &mut View) {
    let mut canvas = Canvas::new(area);
    let robot = picture.status.pose;
    view.settle(canvas.size(), picture.bounds(), robot.map(|[x, y, _]| [x, y]));
    if view.dot_m() <= 0.0 {
        return;
    }
    for ((layer, ..), runs) in &picture.tiles {
        runs.iter().for_each(|run| draw_run(&mut canvas, view, run, picture.cell_m, *layer));
    }
    let dots: Vec<_> = picture.path.iter().map(|point| view.dot(*point)).collect();
    dots.windows(2).for_each(|ends| canvas.line(ends[0], ends[1], Ink::Path));
    picture.particles.iter().for_each(|particle| canvas.dot(view.dot(*particle), Ink::Particle));
    for (hit, is_misfit) in &picture.hits {
        canvas.dot(view.dot(*hit), if *is_misfit { Ink::Misfit } else { Ink::Hit });
    }
    canvas.render(frame.buffer_mut());
    if let Some([x, y, heading]) = robot {
        let eighth = (heading / std::f32::consts::FRAC_PI_4).round().rem_euclid(8.0) as usize % ARROWS.len();
        let [column, row] = [view.dot([x, y])[0].div_euclid(2), view.dot([x, y])[1].div_euclid(4)];
        let is_in = (0..i32::from(area.width)).contains(&column) && (0..i32::from(area.height)).contains(&row);
        let place = (area.x + column.max(0) as u16, area.y + row.max(0) as u16);
        if let Some(cell) = frame.buffer_mut().cell_mut(place).filter(|_| is_in) {
            let style = Style::new().fg(Color::LightYellow).add_modifier(Modifier::BOLD);
            cell.set_char(ARROWS[eighth]).set_style(style);
        }
    }
    draw_scale(frame, area, view);
}

/// Free cells mark the characters that they lie in; walls are dots.
fn draw_run(canvas: &mut Canvas, view: &View, run: &Run, cell_m: f32, layer: u32) {
    let ink = match (run.is_wall, layer) {
        (false, _) => Ink::Free,
        (true, 0) => Ink::Wall,
        (true, _) => Ink::Apart,
    };
    let middle = |column: i32| [(column as f32 + 0.5) * cell_m, (run.row as f32 + 0.5) * cell_m];
    let [first, last] = [run.column, run.column + run.cells - 1].map(|column| view.dot(middle(column)));
    let [width, height] = canvas.size();
    if last[0] < 0 || first[0] >= width || first[1] < 0 || first[1] >= height {
        return;
    }
    // A cell may be larger than a dot.
    let high = (cell_m / view.dot_m()).ceil().clamp(1.0, 400.0) as i32;
    for y in 0..high {
        (first[0].max(0)..=last[0].max(first[0] + high - 1).min(width - 1))
            .for_each(|x| canvas.dot([x, first[1] - high / 2 + y], ink));
    }
}

fn draw_scale(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let length_m = view.scale_m(SCALE);
    let width = ((length_m / view.dot_m()) as u16 / 2).clamp(2, area.width.max(2));
    let text = format!("├{}┤ {length_m} m", "─".repeat(usize::from(width.saturating_sub(2))));
    let place = Rect { y: area.bottom().saturating_sub(1), height: area.height.min(1), ..area };
    let line = Rect { width: area.width.min(text.chars().count() as u16), ..place };
    frame.render_widget(Paragraph::new(text), line);
}

#[cfg(test)]
mod tests;
