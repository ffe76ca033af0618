//! Connections: so many, so long, so large, and no more.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Connections at a time.
pub const CONNECTIONS_MAX: usize = 64;
/// Of one other computer.
const CONNECTIONS_OF_ONE: usize = 24;
/// Bytes of a request's head.
const HEAD_BYTES_MAX: usize = 16 * 1024;
/// For a request's head to come.
const HEAD_WITHIN: Duration = Duration::from_secs(10);
/// A connection is closed after so long, whatever it does: a page makes another.
const LIFETIME: Duration = Duration::from_secs(300);

/// Says something about who comes, once for each kind of trouble.
pub type Tell = Arc<dyn Fn(&str) + Send + Sync>;

/// How many connections each other computer has.
#[derive(Debug, Clone, Default)]
struct Guests(Arc<Mutex<HashMap<IpAddr, usize>>>);

struct Guest(Guests, IpAddr);

impl Guests {
    fn enter(&self, ip: IpAddr) -> Option<Guest> {
        let mut guests = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = guests.entry(ip).or_default();
        if *count >= CONNECTIONS_OF_ONE && !ip.is_loopback() {
            return None;
        }
        *count += 1;
        Some(Guest(self.clone(), ip))
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        let mut guests = self.0.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = guests.get_mut(&self.1) {
            *count -= 1;
            if *count == 0 {
                guests.remove(&self.1);
            }
        }
    }
}

/// Serves whoever comes, for ever.
pub async fn open(listener: TcpListener, router: Router, tell: Tell) {
    let (room, guests) = (Arc::new(Semaphore::new(CONNECTIONS_MAX)), Guests::default());
    let mut has_told = false;
    loop {
        let Ok((stream, from)) = listener.accept().await else {
            // Too many files are open: it gets better or it does not.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        let places = room.clone().try_acquire_owned().ok().zip(guests.enter(from.ip()));
        let Some(place) = places else {
            if !std::mem::replace(&mut has_told, true) {
                tell(&format!("too many connections to the live page: some from {} were refused", from.ip()));
            }
            continue;
        };
        tokio::spawn(serve(stream, router.clone(), place));
    }
}

async fn serve(stream: TcpStream, router: Router, _place: (OwnedSemaphorePermit, Guest)) {
    // Small answers are not held back.
    let _ = stream.set_nodelay(true);
    let service = TowerToHyperService::new(router);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_WITHIN)
        .max_buf_size(HEAD_BYTES_MAX)
        .serve_connection(TokioIo::new(stream), service)
        .with_upgrades();
    // What a guest does wrong ends its connection, and nothing else.
    let _ = tokio::time::timeout(LIFETIME, connection).await;
}
