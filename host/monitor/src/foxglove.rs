//! Foxglove's WebSocket protocol, version 1: what the page shows, for Foxglove, Lichtblick and others.
//!
//! The server tells its channels, a client subscribes to some, and messages follow in binary: 1, the subscription (`u32`), the time in
//! ns (`u64`), little-endian, and JSON by Foxglove's schemas. Source: foxglove/ws-protocol, docs/spec.md.
//!
//! Not here: parameters, services, what clients publish, and the clock.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, RawQuery, State};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse, Response};
use lrfslam_core::geometry::Pose2;
use lrfslam_host::foxglove::{self, FRAME_TRANSFORMS, FREE, GRID, OCCUPIED, POINT_CLOUD, POSE_IN_FRAME, UNKNOWN};
use lrfslam_host::monitor::wire::decode;
use serde_json::{Value, json};
use tokio::time::timeout;

use crate::routes::Shared;
use crate::server::{Robot, Source};

/// Names of the protocol, newest first.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Viewers at a time.
pub const VIEWERS_MAX: usize = 8;
/// How often it is looked whether there is something new.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// A whole map takes long to send: not more often.
const MAP_EVERY: Duration = Duration::from_millis(1000);
/// Who takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes of a client's message.
const MESSAGE_MAX: usize = 1 << 16;
/// Subscriptions of a client.
const SUBSCRIPTIONS_MAX: usize = 64;
/// Cells of a map that is sent.
const CELLS_MAX: i64 = 1 << 24;

/// Name, schema.
type Channel = (&'static str, (&'static str, &'static str));
/// A channel's number is its place here.
const CHANNELS: [Channel; 4] =
    [("/scan", POINT_CLOUD), ("/pose", POSE_IN_FRAME), ("/tf", FRAME_TRANSFORMS), ("/map", GRID)];
const SCAN: usize = 0;
const POSE: usize = 1;
const TRANSFORMS: usize = 2;
const MAP: usize = 3;

/// Who may see the page may see this: with the token behind `?`, from a page of anywhere; without, as the page.
pub async fn open(
    State(shared): State<Arc<Shared>>,
    Path(robot): Path<usize>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    let has_token = query.is_some_and(|token| shared.access.is_token(&token));
    if !has_token && !shared.access.may_see(&headers) {
        return shared.refuse();
    }
    let Some(robot) = shared.robot(robot) else { return StatusCode::NOT_FOUND.into_response() };
    let Ok(place) = shared.viewers.clone().try_acquire_owned() else {
        return StatusCode::SERVICE_UNAVAILABLE.into_response();
    };
    let upgrade = upgrade.protocols(PROTOCOLS).max_message_size(MESSAGE_MAX);
    upgrade.on_upgrade(async move |socket| {
        let viewer = Viewer { socket, robot, shown: Shown::default(), subscriptions: BTreeMap::new(), known: (0, 0) };
        // It went, or took nothing any more.
        let _ = viewer.serve().await;
        drop(place);
    })
}

/// What a client is shown.
struct Viewer {
    socket: WebSocket,
    robot: Robot,
    shown: Shown,
    /// Number of a subscription, and its channel.
    subscriptions: BTreeMap<u32, usize>,
    /// Instance and revision of what was fetched.
    known: (u64, u64),
}

/// The client is gone.
struct Gone;

impl Viewer {
    async fn serve(mut self) -> Result<(), Gone> {
        self.greet().await?;
        loop {
            match timeout(LOOK_EVERY, self.socket.recv()).await {
                Err(_) => self.look().await?,
                Ok(Some(Ok(Message::Text(text)))) => self.hear(&text).await?,
                Ok(Some(Ok(Message::Close(_)) | Err(_)) | None) => return Ok(()),
                Ok(Some(Ok(_))) => {}
            }
        }
    }

    async fn send(&mut self, message: Message) -> Result<(), Gone> {
        let sent = timeout(PATIENCE, self.socket.send(message)).await;
        sent.ok().and_then(Result::ok).ok_or(Gone)
    }

    async fn greet(&mut self) -> Result<(), Gone> {
        let name = format!("lrfslam {}", self.robot.name);
        let session = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros().to_string();
        let info = json!({ "op": "serverInfo", "name": name, "capabilities": [], "supportedEncodings": [],
            "metadata": {}, "sessionId": session });
        let channel = |(id, (topic, (name, schema))): (usize, &Channel)| json!({ "id": id, "topic": topic, "encoding": "json", "schemaName": name, "schema": schema, "schemaEncoding": "jsonschema" });
        let channels: Vec<Value> = CHANNELS.iter().enumerate().map(channel).collect();
        self.send(Message::text(info.to_string())).await?;
        self.send(Message::text(json!({ "op": "advertise", "channels": channels }).to_string())).await
    }

    /// What a client says that is not understood is left.
    async fn hear(&mut self, text: &str) -> Result<(), Gone> {
        let Ok(said) = serde_json::from_str::<Value>(text) else { return Ok(()) };
        let number = |value: &Value| value.as_u64().and_then(|number| u32::try_from(number).ok());
        let list = |key: &str| said[key].as_array().cloned().unwrap_or_default();
        for wanted in list("subscriptions") {
            let (id, channel) = (number(&wanted["id"]), number(&wanted["channelId"]).map(|channel| channel as usize));
            let (Some(id), Some(channel)) = (id, channel.filter(|channel| *channel < CHANNELS.len())) else { continue };
            if self.subscriptions.len() < SUBSCRIPTIONS_MAX && said["op"] == "subscribe" {
                self.subscriptions.insert(id, channel);
                if let Some(message) = self.shown.message(channel) {
                    self.send(binary(id, self.shown.time_ns, &message)).await?;
                }
            }
        }
        for id in list("subscriptionIds").iter().filter_map(number) {
            self.subscriptions.remove(&id);
        }
        Ok(())
    }

    async fn look(&mut self) -> Result<(), Gone> {
        if self.subscriptions.is_empty() {
            return Ok(());
        }
        if let Some(changes) = fetch(&self.robot, self.known).await {
            self.known = self.shown.take(&changes).unwrap_or((0, 0));
        }
        for channel in self.shown.news() {
            let ids: Vec<u32> =
                self.subscriptions.iter().filter(|(_, of)| **of == channel).map(|(id, _)| *id).collect();
            let message = (!ids.is_empty()).then(|| self.shown.message(channel)).flatten();
            for id in ids {
                let Some(message) = &message else { break };
                self.send(binary(id, self.shown.time_ns, message)).await?;
            }
        }
        Ok(())
    }
}

/// What is new, if anything is.
async fn fetch(robot: &Robot, known: (u64, u64)) -> Option<Vec<u8>> {
    let (instance, revision) = known;
    match &robot.source {
        Source::Here(monitor) => {
            monitor.look();
            let is_new = (monitor.instance(), monitor.revision()) != known;
            is_new.then(|| monitor.changes(instance, revision))
        }
        Source::There(remote) => {
            let path = format!("/robots/0/changes?{instance}-{revision}");
            let answer = remote.ask(Method::GET, &path).await;
            answer.filter(|(status, _)| *status == StatusCode::OK).map(|(_, state)| state.to_vec())
        }
    }
}

fn binary(subscription: u32, time_ns: u64, message: &[u8]) -> Message {
    let head = [&[1], &subscription.to_le_bytes()[..], &time_ns.to_le_bytes()].concat();
    Message::binary([&head, message].concat())
}

/// The state, as far as it is shown.
#[derive(Default)]
struct Shown {
    time_ns: u64,
    /// x, y, heading; m, rad.
    pose: Option<[f32; 3]>,
    hits: Vec<[f32; 3]>,
    cell_size_m: f32,
    /// Cells of a tile's edge.
    tile_cells: usize,
    /// Column and row: its cells.
    tiles: BTreeMap<(i32, i32), Vec<u8>>,
    is_new: [bool; CHANNELS.len()],
    map_sent: Option<Instant>,
}

impl Shown {
    /// Takes changes over; which state they lead to.
    fn take(&mut self, changes: &[u8]) -> Option<(u64, u64)> {
        let (instance, revision, is_all, sections) = decode(changes)?;
        if is_all {
            self.tiles.clear();
        }
        for (kind, content) in sections {
            match kind {
                1 => self.take_status(content),
                2 => {
                    self.take_tiles(content);
                    self.is_new[MAP] = true;
                }
                5 => {
                    let values: Vec<f32> = f32s(content).collect();
                    self.hits = values.chunks_exact(3).map(|hit| [hit[0], hit[1], 0.0]).collect();
                    self.is_new[SCAN] = true;
                }
                _ => {}
            }
        }
        Some((instance, revision))
    }

    fn take_status(&mut self, content: &[u8]) {
        let Ok(status) = serde_json::from_slice::<Value>(content) else { return };
        let seconds = status["time_s"].as_f64().unwrap_or(0.0);
        self.time_ns = (seconds.max(0.0) * 1e6).round() as u64 * 1000;
        let numbers = status["pose"].as_array().map(|pose| pose.iter().filter_map(Value::as_f64).collect::<Vec<_>>());
        if let Some([x, y, heading]) = numbers.as_deref() {
            self.pose = Some([*x, *y, *heading].map(|value| value as f32));
            (self.is_new[POSE], self.is_new[TRANSFORMS]) = (true, true);
        }
    }

    fn take_tiles(&mut self, content: &[u8]) {
        let u32_at = |at: usize| content.get(at..at + 4)?.first_chunk().map(|bytes| u32::from_le_bytes(*bytes));
        let (Some(cell_size), Some(edge), Some(count)) = (u32_at(0), u32_at(4), u32_at(8)) else { return };
        (self.cell_size_m, self.tile_cells) = (f32::from_bits(cell_size), edge as usize);
        let mut at = 12;
        for _ in 0..count {
            let head = [0, 4, 8, 12].map(|place| u32_at(at + place));
            let [Some(layer), Some(column), Some(row), Some(length)] = head else { return };
            at += 16;
            let Some(runs) = content.get(at..at + length as usize) else { return };
            at = (at + length as usize).next_multiple_of(4);
            // The piece of a robot that was lost is no part of the map.
            if layer == 0 {
                self.tiles.insert((column as i32, row as i32), runs.iter().flat_map(|run| run_of(*run)).collect());
            }
        }
    }

    /// Channels with something new.
    fn news(&mut self) -> Vec<usize> {
        let is_early = self.map_sent.is_some_and(|sent| sent.elapsed() < MAP_EVERY);
        let new: Vec<usize> =
            (0..CHANNELS.len()).filter(|channel| self.is_new[*channel] && !(*channel == MAP && is_early)).collect();
        for channel in &new {
            self.is_new[*channel] = false;
        }
        if new.contains(&MAP) {
            self.map_sent = Some(Instant::now());
        }
        new
    }

    /// What a channel shows now, if it is anything.
    fn message(&self, channel: usize) -> Option<Vec<u8>> {
        let pose = || self.pose.map(|[x, y, heading]| Pose2::new(x, y, heading));
        match channel {
            SCAN => Some(foxglove::points(self.time_ns, self.hits.iter().copied())).filter(|_| !self.hits.is_empty()),
            POSE => Some(foxglove::pose(self.time_ns, pose()?)),
            TRANSFORMS => Some(foxglove::transforms(self.time_ns, pose()?, None)),
            _ => self.map(),
        }
    }

    fn map(&self) -> Option<Vec<u8>> {
        let known = || self.tiles.iter().filter(|(_, cells)| !cells.is_empty()).map(|(place, _)| *place);
        let span = |of: fn((i32, i32)) -> i32| Some((known().map(of).min()?, known().map(of).max()?));
        let ((left, right), (bottom, top)) = (span(|(column, _)| column)?, span(|(_, row)| row)?);
        let edge = self.tile_cells as i64;
        let (width, height) =
            ((i64::from(right) - i64::from(left) + 1) * edge, (i64::from(top) - i64::from(bottom) + 1) * edge);
        if width.checked_mul(height)? > CELLS_MAX {
            return None;
        }
        let edge = self.tile_cells;
        let cell = |row: usize, column: usize| {
            let tile = (left + (column / edge) as i32, bottom + (row / edge) as i32);
            let cells = self.tiles.get(&tile);
            cells.and_then(|cells| cells.get(row % edge * edge + column % edge)).copied().unwrap_or(UNKNOWN)
        };
        let cells = (0..height as usize).flat_map(|row| (0..width as usize).map(move |column| (row, column)));
        let size_m = (f64::from(self.cell_size_m) * 1e6).round() / 1e6;
        let origin = [left, bottom].map(|index| f64::from(index) * edge as f64 * size_m);
        let cells = (width as usize, cells.map(|(row, column)| cell(row, column)));
        Some(foxglove::cells(self.time_ns, (origin[0], origin[1]), size_m, cells))
    }
}

/// The cells of a run: two bits of what, six of how many less one.
fn run_of(run: u8) -> impl Iterator<Item = u8> {
    let what = match run >> 6 {
        1 => FREE,
        2 => OCCUPIED,
        _ => UNKNOWN,
    };
    std::iter::repeat_n(what, usize::from(run & 63) + 1)
}

fn f32s(content: &[u8]) -> impl Iterator<Item = f32> + '_ {
    content.chunks_exact(4).filter_map(|bytes| bytes.first_chunk().map(|bytes| f32::from_le_bytes(*bytes)))
}
