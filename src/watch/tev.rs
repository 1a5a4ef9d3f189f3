//! Pictures for the viewer tev, by its own protocol, as they grow.
//!
//! A viewer that is not there, is slow, or goes away never holds up a picture: what is to be sent waits in a place for one, where
//! newer pixels take the place of older ones, and a thread of its own sends it or tries again a little later.

use crate::error::Error;
use crate::watch::board::Picture;
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// Where tev listens.
pub const ADDRESS: &str = "127.0.0.1:14158";
/// Pause before a viewer that was not there is looked for again.
const RETRY: Duration = Duration::from_secs(2);
/// Longest that a viewer may take to answer, or to take some bytes.
const PATIENCE: Duration = Duration::from_secs(5);

/// A viewer that may or may not be there.
#[derive(Clone)]
pub struct Tev(Arc<Shared>);

#[derive(Default)]
struct Shared {
    /// What is to be shown next.
    next: Mutex<Option<Picture>>,
    comes: Condvar,
}

impl Tev {
    /// Sends pictures to the viewer at an address such as `127.0.0.1:14158`, under a name; `tell` hears when it is found and lost.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub fn start(address: String, name: String, tell: impl Fn(String) + Send + 'static) -> Result<Self, Error> {
        let shared = Arc::new(Shared::default());
        let own = shared.clone();
        // The protocol ends texts so.
        let name = name.replace('\0', "");
        thread::Builder::new()
            .name("tev".into())
            .spawn(move || own.send_all(&address, &name, &tell))
            .map_err(|e| Error::Internal(format!("no thread can be started: {e}")))?;
        Ok(Self(shared))
    }

    /// Will show a picture as it is now.
    pub fn show(&self, picture: &Picture) {
        *self.0.lock() = Some(picture.clone());
        self.0.comes.notify_one();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Option<Picture>> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next picture, if one comes soon.
    fn take(&self) -> Option<Picture> {
        let waited = self.comes.wait_timeout_while(self.lock(), RETRY, |next| next.is_none());
        waited.map_or_else(|e| e.into_inner().0.take(), |(mut next, _)| next.take())
    }

    fn send_all(&self, address: &str, name: &str, tell: &dyn Fn(String)) {
        let mut connection: Option<Connection> = None;
        let mut last: Option<Picture> = None;
        let mut is_told = false;
        loop {
            let next = self.take();
            if connection.as_ref().is_some_and(Connection::is_closed) {
                connection = None;
            }
            // A viewer that is started anew gets the picture that is there.
            let is_news = next.is_some() || connection.is_none();
            last = next.or(last);
            let Some(picture) = last.as_ref().filter(|picture| is_news && !picture.data.is_empty()) else { continue };
            let connected = match connection.take() {
                Some(connected) => Ok(connected),
                None => Connection::open(address),
            };
            let sent = connected.and_then(|mut connected| {
                connected.send(name, picture)?;
                Ok(connected)
            });
            match sent {
                Ok(connected) => {
                    connection = Some(connected);
                    if is_told {
                        tell(format!("tev at {address} shows the picture"));
                    }
                    is_told = false;
                }
                Err(error) => {
                    if !is_told {
                        let seconds = RETRY.as_secs();
                        tell(format!("tev at {address} is not there: {error}; it is looked for every {seconds} s"));
                    }
                    is_told = true;
                    thread::sleep(RETRY);
                }
            }
        }
    }
}

struct Connection {
    client: TevClient,
    /// The same, to see whether the other side has closed it.
    stream: TcpStream,
    /// Size and channels of the picture that the viewer has.
    shown: Option<([u32; 2], Vec<String>)>,
}

impl Connection {
    fn open(address: &str) -> io::Result<Self> {
        let stream = connect(address)?;
        Ok(Self { client: TevClient::wrap(stream.try_clone()?), stream, shown: None })
    }

    /// Whether the viewer has gone: the first bytes that are written then would be lost without a word.
    fn is_closed(&self) -> bool {
        let peek = || {
            self.stream.set_nonblocking(true)?;
            let end = self.stream.peek(&mut [0]);
            self.stream.set_nonblocking(false)?;
            end
        };
        match peek() {
            Ok(count) => count == 0,
            Err(error) => error.kind() != io::ErrorKind::WouldBlock,
        }
    }

    fn send(&mut self, name: &str, picture: &Picture) -> io::Result<()> {
        let [width, height] = picture.resolution;
        let channels = picture.channels();
        let shown = (picture.resolution, channels.clone());
        if self.shown.as_ref() != Some(&shown) {
            let channel_names = &channels;
            self.client.send(PacketCreateImage { image_name: name, grab_focus: true, width, height, channel_names })?;
            self.shown = Some(shown);
        }
        let count = channels.len() as u64;
        self.client.send(PacketUpdateImage {
            image_name: name,
            grab_focus: false,
            channel_names: &channels,
            channel_offsets: &(0..count).collect::<Vec<_>>(),
            channel_strides: &vec![count; channels.len()],
            x: 0,
            y: 0,
            width,
            height,
            data: &picture.data,
        })
    }
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "no such host");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}
