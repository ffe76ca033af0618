//! What may be asked for: the page, changes of a robot's state, and commands.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use axum::Router;
use axum::extract::{DefaultBodyLimit, Path, RawQuery, State};
use axum::http::{HeaderMap, HeaderName, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use lrfslam_host::monitor::{Ask, Monitor, give_way};

use crate::access::Access;
use crate::doors::Tell;
use crate::server::{Robot, Robots, Source};

/// Bytes of a request's body: no request has one.
const BODY_BYTES_MAX: usize = 1024;
/// Who has all there is waits so long for more, and asks again.
pub const WAIT: Duration = Duration::from_millis(1000);
/// How often it is looked whether there is more.
pub const POLL: Duration = Duration::from_millis(20);
/// So many states are sent before the server gives way to what else runs.
const AT_ONCE: usize = 30;
/// Where a robot's status is.
pub const STATUS: &str = "/robots/0/status";

/// What the page may do: nothing but draw, and talk to where it came from.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Files of the page: name, type, content.
const FILES: [(&str, &str, &str); 9] = [
    ("", "text/html; charset=utf-8", include_str!("../page/index.html")),
    ("style.css", "text/css; charset=utf-8", include_str!("../page/style.css")),
    ("main.js", SCRIPT, include_str!("../page/main.js")),
    ("state.js", SCRIPT, include_str!("../page/state.js")),
    ("map.js", SCRIPT, include_str!("../page/map.js")),
    ("view.js", SCRIPT, include_str!("../page/view.js")),
    ("cloud.js", SCRIPT, include_str!("../page/cloud.js")),
    ("graphs.js", SCRIPT, include_str!("../page/graphs.js")),
    ("colours.js", SCRIPT, include_str!("../page/colours.js")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// What all requests share.
pub struct Shared {
    pub access: Access,
    robots: Robots,
    pub tell: Tell,
    has_told: AtomicBool,
    /// States that were sent.
    sent: AtomicUsize,
    /// Places for Foxglove and others.
    #[cfg(feature = "foxglove")]
    pub viewers: Arc<tokio::sync::Semaphore>,
}

/// All routes.
pub fn router(shared: Arc<Shared>) -> Router {
    let router = Router::new();
    #[cfg(feature = "foxglove")]
    let router = router.route("/robots/{robot}/foxglove", get(crate::foxglove::open));
    router
        .route("/", get(|| file("")))
        .route("/{file}", get(|Path(name): Path<String>| async move { file(&name).await }))
        .route("/robots", get(robots))
        .route("/robots/{robot}/changes", get(changes))
        .route("/robots/{robot}/status", get(status))
        .route("/robots/{robot}/{ask}", post(ask))
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .with_state(shared)
}

async fn file(name: &str) -> Response {
    let Some((_, kind, content)) = FILES.iter().find(|(known, ..)| *known == name) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, *kind),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-cache"),
    ];
    (headers, *content).into_response()
}

impl Shared {
    /// Nobody was here yet.
    pub fn new(access: Access, robots: Robots, tell: Tell) -> Self {
        Self {
            access,
            robots,
            tell,
            has_told: AtomicBool::new(false),
            sent: AtomicUsize::new(0),
            #[cfg(feature = "foxglove")]
            viewers: Arc::new(tokio::sync::Semaphore::new(crate::foxglove::VIEWERS_MAX)),
        }
    }

    /// One of the robots, as it is now.
    pub fn robot(&self, index: usize) -> Option<Robot> {
        self.robots.get(index)
    }

    /// The first pictures come at once, on a busy computer too.
    fn count_sent(&self) {
        if self.sent.fetch_add(1, Ordering::Relaxed) == AT_ONCE {
            give_way();
        }
    }

    pub fn refuse(&self) -> Response {
        if !self.has_told.swap(true, Ordering::Relaxed) {
            (self.tell)("somebody without the token, or from another page, was refused the live page");
        }
        StatusCode::UNAUTHORIZED.into_response()
    }
}

/// Names of the robots, and whether who asks may command.
async fn robots(State(shared): State<Arc<Shared>>, headers: HeaderMap) -> Response {
    if !shared.access.may_see(&headers) {
        return shared.refuse();
    }
    // What they will ask for next is drawn meanwhile.
    let (robots, may_grow) = shared.robots.all();
    for robot in &robots {
        if let Source::Here(monitor) = &robot.source {
            monitor.look();
        }
    }
    let names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).collect();
    let may_command = shared.access.may_command(&headers);
    let answer = serde_json::json!({ "robots": names, "may_grow": may_grow, "may_command": may_command });
    ([(header::CONTENT_TYPE, "application/json")], answer.to_string()).into_response()
}

/// What changed since `?INSTANCE-REVISION`, once something has, or after a while.
async fn changes(
    State(shared): State<Arc<Shared>>,
    Path(robot): Path<usize>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    if !shared.access.may_see(&headers) {
        return shared.refuse();
    }
    let query = query.as_deref().unwrap_or("0-0");
    let known = query.split_once('-');
    let known = known.and_then(|(instance, revision)| Some((instance.parse().ok()?, revision.parse().ok()?)));
    let (Some(robot), Some((instance, revision))) = (shared.robot(robot), known) else {
        return StatusCode::BAD_REQUEST.into_response();
    };
    let headers: [(HeaderName, &str); 2] =
        [(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "no-store")];
    match &robot.source {
        Source::Here(monitor) => {
            shared.count_sent();
            (headers, state(monitor, instance, revision).await).into_response()
        }
        Source::There(remote) => {
            let path = format!("/robots/0/changes?{instance}-{revision}");
            match remote.ask(Method::GET, &path).await {
                Some((StatusCode::OK, state)) => (headers, state).into_response(),
                _ => StatusCode::BAD_GATEWAY.into_response(),
            }
        }
    }
}

/// The changes, once there are some.
async fn state(monitor: &Monitor, instance: u64, revision: u64) -> Vec<u8> {
    monitor.look();
    let mut waited = Duration::ZERO;
    while waited < WAIT && instance == monitor.instance() && revision == monitor.revision() {
        tokio::time::sleep(POLL).await;
        waited += POLL;
    }
    monitor.look();
    monitor.changes(instance, revision)
}

/// How things stand now, as JSON: for programs.
async fn status(State(shared): State<Arc<Shared>>, Path(robot): Path<usize>, headers: HeaderMap) -> Response {
    if !shared.access.may_see(&headers) {
        return shared.refuse();
    }
    let Some(robot) = shared.robot(robot) else { return StatusCode::NOT_FOUND.into_response() };
    let status = match &robot.source {
        Source::Here(monitor) => {
            // What nobody has looked at is old.
            state(monitor, monitor.instance(), monitor.revision()).await;
            serde_json::to_vec(&monitor.status()).unwrap_or_default()
        }
        Source::There(remote) => match remote.ask(Method::GET, STATUS).await {
            Some((StatusCode::OK, status)) => status.to_vec(),
            _ => return StatusCode::BAD_GATEWAY.into_response(),
        },
    };
    ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-store")], status).into_response()
}

/// A command, to who has the token.
async fn ask(
    State(shared): State<Arc<Shared>>,
    Path((robot, ask)): Path<(usize, String)>,
    headers: HeaderMap,
) -> Response {
    if !shared.access.may_command(&headers) {
        return shared.refuse();
    }
    let wanted = match ask.as_str() {
        "save" => Ask::Save,
        "pause" => Ask::Pause(true),
        "resume" => Ask::Pause(false),
        "stop" => Ask::Stop,
        _ => return StatusCode::NOT_FOUND.into_response(),
    };
    let Some(robot) = shared.robot(robot) else { return StatusCode::NOT_FOUND.into_response() };
    match &robot.source {
        Source::Here(monitor) => monitor.ask(wanted),
        Source::There(remote) => {
            let answer = remote.ask(Method::POST, &format!("/robots/0/{ask}")).await;
            return answer.map_or(StatusCode::BAD_GATEWAY, |(status, _)| status).into_response();
        }
    }
    StatusCode::NO_CONTENT.into_response()
}
