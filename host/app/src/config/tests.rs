use super::*;

fn load(text: &str, overrides: &[&str]) -> Result<RunConfig, String> {
    let file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    std::fs::write(file.path(), text).unwrap();
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    RunConfig::load_over(RunConfig::default(), Some(file.path()), &overrides).map_err(|error| error.to_string())
}

#[test]
fn printed_configuration_is_read_back() {
    let mut config = RunConfig::default();
    config.map.cell_size_m = 0.025;
    config.mounting.from_log = false;
    let text = config.to_commented_toml();
    assert_eq!(load(&text, &[]), Ok(config));
    assert!(text.contains("\n# How the log is read.\n[log]\n"), "{text}");
    assert!(text.contains("# 0.0 to 1000.0\nrange_max_m = 0.0\n"), "{text}");
    assert!(text.contains("from_log = false\n"), "{text}");
}

#[test]
fn every_number_says_what_it_means() {
    for (name, section) in RunConfig::default().sections() {
        assert!(!section.doc().is_empty(), "[{name}] is not documented");
        section.visit(&mut |field| assert!(!field.doc.is_empty(), "{name}.{} is not documented", field.name));
    }
}

#[test]
fn overrides_win_over_the_file_and_the_file_over_defaults() {
    let config = load("[map]\ncell_size_m = 0.1\n[log]\nrange_max_m = 30\n", &["map.cell_size_m=0.2"]).unwrap();
    assert_eq!((config.map.cell_size_m, config.log.range_max_m), (0.2, 30.0));
    assert_eq!(config.map.occupied_share, MapConfig::default().occupied_share);
    assert!(!load("", &["mounting.from_log = false"]).unwrap().mounting.from_log);
}

#[test]
fn robots_have_defaults_of_their_own_and_the_file_wins_over_them() {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), "[particles]\nsamples_per_particle = 2\n[ndt]\ngrids = 4\n").unwrap();
    let config = RunConfig::load_over(RunConfig::for_robot(), Some(file.path()), &["rays.range_max_m=5".into()]);
    let config = config.unwrap().robot(7, LaserConfig::default());
    let default = RobotConfig::default();
    assert_eq!((config.slam.particles.particles, config.slam.particles.samples_per_particle), (32, 2));
    assert_eq!((config.slam.ndt.grids, config.slam.rays.range_max_m, config.seed), (4, 5.0, 7));
    assert_eq!(RunConfig::for_robot().robot(default.seed, default.laser), default);
}

#[test]
fn wrong_files_name_line_key_and_expectation() {
    let error = load("[map]\n\ncel_size_m = 0.1\n", &[]).unwrap_err();
    assert!(error.contains("line 3") && error.contains("cel_size_m") && error.contains("cell_size_m"), "{error}");
    let error = load("[map]\ncell_size_m = \"big\"\n", &[]).unwrap_err();
    assert!(error.contains("line 2") && error.contains("f32"), "{error}");
    assert!(load("[map\n", &[]).unwrap_err().contains("line 1"));
    assert!(load("[nonsense]\n", &[]).unwrap_err().contains("expected one of"));
    let error = load("[map]\ncell_size_m = -1.0\n", &[]).unwrap_err();
    assert_eq!(error, "configuration: map.cell_size_m is -1.0, expected 0.005 to 1.0");
    assert!(load("[map]\ncell_size_m = nan\n", &[]).unwrap_err().contains("is NaN"));
}

#[test]
fn wrong_overrides_name_themselves() {
    let error = |o: &str| load("", &[o]).unwrap_err();
    assert!(error("map.cell=1").contains("--set map.cell=1: unknown field `cell`"));
    assert!(error("mapp.cell_size_m=1").contains(
        "there is no section `mapp`, expected one of closure, de, filter, hierarchy, high, localize, log, map"
    ));
    assert!(error("cell_size_m").contains("expected section.key=value"));
    assert!(error("map.cell_size_m=wide").contains("invalid type"));
    assert!(error("map.cell_size_m=9").contains("map.cell_size_m is 9.0"));
}

#[test]
fn keys_and_sections_of_older_files_are_said_to_be_gone() {
    let told = "`lrfslam config` prints all that there are; older versions had more";
    for text in ["[ndt]\npoints_min = 3\n", "[segment]\ntravel_m = 4.0\n"] {
        let error = load(text, &[]).unwrap_err();
        assert!(error.ends_with(told), "{error}");
    }
    for argument in ["closure.sigma_m=0.1", "refinement.rounds=3"] {
        let error = load("", &[argument]).unwrap_err();
        assert!(error.ends_with(told), "{error}");
    }
    assert!(!load("[map]\ncell_size_m = \"big\"\n", &[]).unwrap_err().contains(told));
}

/// The key that made older maps unreadable once, and a value that was right once.
#[test]
fn a_map_made_with_a_configuration_of_another_program_is_called_so_and_not_damaged() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/map-4");
    let saved = SavedMap::read(&golden).unwrap();
    assert_eq!(RunConfig::of_saved(&saved, &golden).unwrap().ndt, RunConfig::default().ndt);
    for (config, what) in [
        (saved.config.replace("grids = 4", "overlapping = true"), "unknown field `overlapping`"),
        (saved.config.replace("grids = 4", "grids = 400"), "ndt.grids is 400, expected 1 to 4"),
    ] {
        let saved = SavedMap { program: "0.0.9".to_owned(), config, ..saved.clone() };
        let error = RunConfig::of_saved(&saved, &golden).unwrap_err().to_string();
        let told = "made by lrfslam 0.0.9, whose configuration this program does not know: ";
        assert!(error.contains(told) && error.contains(what) && error.ends_with("; map the log again"), "{error}");
    }
}

/// `section.key` of every value.
fn keys(config: &str) -> Vec<String> {
    let sections: toml::Table = toml::from_str(config).unwrap();
    let keys = |(section, fields): (&String, &toml::Value)| {
        let fields = fields.as_table().unwrap();
        fields.keys().map(|key| format!("{section}.{key}")).collect::<Vec<_>>()
    };
    sections.iter().flat_map(keys).collect()
}

/// A key that goes or is called otherwise makes maps unreadable that were saved before: that asks for a new version of `map.lrfslam`.
#[test]
fn maps_hold_the_keys_of_today() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/map-4");
    let saved = SavedMap::read(&golden).unwrap();
    let config = toml::to_string(&RunConfig::default()).unwrap();
    let today = keys(&config);
    if std::env::var_os("LRFSLAM_RENEW_GOLDEN").is_some() && keys(&saved.config) != today {
        std::fs::write(golden.join("config.toml"), config).unwrap();
    }
    assert_eq!(
        keys(&saved.config),
        today,
        "if a key went, raise VERSION in host/src/mapping/saved_map.rs; then renew configuration and map: \
         LRFSLAM_RENEW_GOLDEN=1 cargo test -p lrfslam config && LRFSLAM_RENEW_GOLDEN=1 cargo test -p lrfslam-host saved_map"
    );
}
