//! Commands that a build may be without.

use crate::common::run;

#[test]
fn what_is_not_built_in_says_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let commands = [
        ("demo", "demo", ["demo", "--world", "castle"], cfg!(feature = "demo")),
        ("experiment", "experiments", ["experiment", "growth", "castle"], cfg!(feature = "experiments")),
        ("prove", "experiments", ["prove", "--data", "castle"], cfg!(feature = "experiments")),
    ];
    for (command, feature, arguments, is_built_in) in commands {
        let (_, help, _) = run(folder.path(), &["--help"]);
        assert!(help.contains(&format!("\n  {command} ")), "{help}");
        let (code, stdout, stderr) = run(folder.path(), &arguments);
        assert!(code == 2 && stdout.is_empty() && stderr.lines().count() == 1, "{stderr}");
        let how = format!("cargo install --locked --path host/app --features {feature}");
        let wanted = if is_built_in { "castle: cannot be read" } else { &how };
        assert!(stderr.contains(wanted), "{stderr}");
    }
    // Of the terminal view: it needs a terminal, which a test has not.
    let (code, stdout, stderr) = run(folder.path(), &["map", "castle", "--tui"]);
    assert!(code == 2 && stdout.is_empty() && stderr.lines().count() == 1, "{stderr}");
    let wanted = if cfg!(feature = "tui") { "--tui needs a terminal" } else { "--features tui" };
    assert!(stderr.contains(wanted), "{stderr}");
    // Of Zenoh, whose place is looked at first.
    let of_watch = if cfg!(feature = "monitor") { "zenoh" } else { "monitor" };
    for (arguments, feature) in
        [(["map", "castle", "--zenoh=a b"], "zenoh"), (["watch", "--json", "zenoh:a b"], of_watch)]
    {
        let (code, stdout, stderr) = run(folder.path(), &arguments);
        assert!(code == 2 && stdout.is_empty(), "{stderr}");
        let how = format!("--features {feature}");
        let wanted = if cfg!(feature = "zenoh") { "of a Zenoh router" } else { &how };
        assert!(stderr.contains(wanted), "{stderr}");
    }
}
