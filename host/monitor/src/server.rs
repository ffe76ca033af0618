//! The server: a thread with one event loop, of low priority once the first pictures were sent.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use lrfslam_host::monitor::Monitor;

use crate::access::{Access, LOOPBACK};
use crate::doors::{self, Tell};
use crate::remote::Remote;
use crate::routes::{Shared, router};

/// A robot that is watched.
#[derive(Debug, Clone)]
pub struct Robot {
    /// What the page calls it.
    pub name: String,
    /// Where its state is.
    pub source: Source,
}

/// Where a robot's state is.
#[derive(Debug, Clone)]
pub enum Source {
    /// In this process.
    Here(Monitor),
    /// In another program.
    There(Remote),
}

/// How the page is served.
pub struct ServerConfig {
    /// Where; a port of 0 is any that is free.
    pub address: SocketAddr,
    /// Instead of a random one.
    pub token: Option<String>,
    /// Is told of whoever was refused, once for each kind of trouble.
    pub tell: Tell,
}

/// The robots of a page: more may come, and none goes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Robots(Arc<RwLock<(Vec<Robot>, bool)>>);

impl Robots {
    /// One of them.
    pub fn get(&self, index: usize) -> Option<Robot> {
        self.read().0.get(index).cloned()
    }

    /// All, and whether more may come.
    pub fn all(&self) -> (Vec<Robot>, bool) {
        self.read().clone()
    }

    fn read(&self) -> RwLockReadGuard<'_, (Vec<Robot>, bool)> {
        self.0.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, (Vec<Robot>, bool)> {
        self.0.write().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A page that is served until the process ends.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    access: Access,
    robots: Robots,
}

impl Robot {
    /// One that this process maps for.
    pub fn here(name: &str, monitor: Monitor) -> Self {
        Self { name: name.to_owned(), source: Source::Here(monitor) }
    }

    /// One that another program maps for.
    pub fn there(remote: Remote) -> Self {
        Self { name: remote.host().to_owned(), source: Source::There(remote) }
    }
}

impl Server {
    /// Serves the page of `robots` from now on.
    ///
    /// # Errors
    /// If nobody can listen at the address, or there is no thread or random number to be had.
    pub fn start(config: ServerConfig, robots: Vec<Robot>) -> io::Result<Self> {
        let listener = listen(config.address)?;
        let address = listener.local_addr()?;
        let access = Access::new(address, config.token)?;
        let tell = config.tell;
        let robots = Robots(Arc::new(RwLock::new((robots, false))));
        let shared = Shared::new(access.clone(), robots.clone(), tell.clone());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        std::thread::Builder::new().name("live page".to_owned()).spawn(move || {
            runtime.block_on(async {
                match tokio::net::TcpListener::from_std(listener) {
                    Ok(listener) => doors::open(listener, router(Arc::new(shared)), tell).await,
                    Err(error) => tell(&format!("the live page is not served: {error}")),
                }
            });
        })?;
        Ok(Self { address, access, robots })
    }

    /// More robots may come: the page asks for them now and then.
    pub fn let_grow(&self) {
        self.robots.write().1 = true;
    }

    /// Shows one more.
    pub fn add(&self, robot: Robot) {
        self.robots.write().0.push(robot);
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The token.
    pub fn token(&self) -> &str {
        self.access.token()
    }

    /// What to open in a browser; the token is in the part that a browser tells nobody.
    pub fn url(&self) -> String {
        let ip = if self.address.ip().is_unspecified() { own_address() } else { self.address.ip() };
        format!("http://{}/#{}", SocketAddr::new(ip, self.address.port()), self.token())
    }
}

/// At the default address any port will do if its own is taken.
fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let listener = match TcpListener::bind(address) {
        Err(error) if address == LOOPBACK && error.kind() == io::ErrorKind::AddrInUse => {
            TcpListener::bind(SocketAddr::new(address.ip(), 0))
        }
        bound => bound,
    }?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// The address at which others reach this computer: from where a datagram to afar would go. None is sent.
fn own_address() -> IpAddr {
    let asked = UdpSocket::bind("0.0.0.0:0").and_then(|socket| {
        socket.connect("192.0.2.1:9")?;
        socket.local_addr()
    });
    asked.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |address| address.ip())
}
