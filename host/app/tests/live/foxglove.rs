//! Foxglove's protocol, with Foxglove's own client where npm has put it: `npm install @foxglove/ws-protocol ws`, and `NODE_PATH` to it.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::page::{TOKEN, Watched};

fn node(arguments: &[&str]) -> std::io::Result<std::process::Output> {
    Command::new("node").args(arguments).stdin(Stdio::null()).output()
}

#[test]
fn foxglove_s_own_client_sees_scan_pose_frames_and_map() {
    let is_there = node(&["-e", "require('@foxglove/ws-protocol'); require('ws')"]);
    if !is_there.is_ok_and(|output| output.status.success()) {
        println!("skipped: node has no @foxglove/ws-protocol and ws (npm, NODE_PATH)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // Long enough that the client is there while scans come.
    let served = Watched::start(folder.path(), "0", 800, &["--monitor-stay"]);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/live/foxglove_client.cjs");
    let url = format!("ws://{}/robots/0/foxglove?{TOKEN}", served.host);
    let output = node(&[script.to_str().unwrap(), &url]).unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text} {}", String::from_utf8_lossy(&output.stderr));
    let seen: serde_json::Value = serde_json::from_str(&text).unwrap();
    let schemas = [
        ("/scan", "foxglove.PointCloud"),
        ("/pose", "foxglove.PoseInFrame"),
        ("/tf", "foxglove.FrameTransforms"),
        ("/map", "foxglove.Grid"),
    ];
    for (topic, schema) in schemas {
        assert_eq!(seen[topic]["schemaName"], schema, "{seen}");
    }
    let map = &seen["/map"]["message"];
    let cells = map["data"].as_str().unwrap().len() as u64 / 4 * 3;
    let columns = map["column_count"].as_u64().unwrap();
    assert!(columns > 0 && cells / columns > 0 && map["cell_size"]["x"] == 0.05, "{columns} columns, {cells} cells");
    let transform = &seen["/tf"]["message"]["transforms"][0];
    assert_eq!((&transform["parent_frame_id"], &transform["child_frame_id"]), (&"map".into(), &"base_link".into()));
}

#[test]
fn who_may_not_see_the_page_sees_nothing_here() {
    let folder = tempfile::tempdir().unwrap();
    let served = Watched::start(folder.path(), "0", 60, &["--monitor-stay", "--levels", "0"]);
    let upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                   Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let status =
        |path: &str, more: &str| served.status(&format!("GET /robots/0/foxglove{path}"), &format!("{upgrade}{more}"));
    let foreign = "Origin: https://app.foxglove.dev\r\n";
    assert_eq!(status("", ""), "101", "on this computer everybody may see");
    assert_eq!(status("", foreign), "401");
    assert_eq!(status("?0000", foreign), "401");
    assert_eq!(status(&format!("?{TOKEN}"), foreign), "101");
    assert_eq!(served.status("GET /robots/7/foxglove", upgrade), "404");
}
