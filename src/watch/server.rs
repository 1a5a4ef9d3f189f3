//! The board as a web page, for this machine alone.
//!
//! Only requests that name this machine as their host are answered, so that no page from elsewhere reads the board by giving its own
//! name this machine's address, and none that another page has sent. The page brings all that it needs with it.

use crate::error::Error;
use crate::render::film::PixelBounds;
use crate::watch::board::Board;
use crate::watch::view_table;
use serde_json::{Map, Value, json};
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// The port unless another is wished for.
pub const PORT: u16 = 7640;
/// Longest that a request waits for news, and that a page may take to ask or to read.
const PATIENCE: Duration = Duration::from_secs(10);
/// Pause before another connection is tried where one could not be taken.
const RETRY: Duration = Duration::from_millis(200);
/// Connections that are open at once.
const CONNECTIONS_MAX: usize = 48;
/// Longest head of a request [bytes], and most headers in it.
const HEAD_MAX: usize = 16 << 10;
const HEADERS_MAX: usize = 64;
/// Longest address that is read [bytes].
const ADDRESS_MAX: usize = 512;
/// The page loads from its own server alone, and no other page shows it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPT: &str = include_str!("page/page.js");

/// Serves the board from now on, in threads of its own; the address of the page. `tell` is told when connections cannot be taken.
///
/// # Errors
/// Where the port is taken; 0 takes any that is free.
pub fn serve(board: &Arc<Board>, port: u16, tell: impl Fn(String) + Send + 'static) -> Result<String, Error> {
    let taken = |e: io::Error| {
        Error::Usage(format!(
            "--serve {port}: the page cannot be served there: {e}; choose another port, or 0 for any that is free"
        ))
    };
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(taken)?;
    let port = listener.local_addr().map_err(taken)?.port();
    let (board, busy) = (board.clone(), Arc::new(()));
    let listen = move || {
        let mut is_told = false;
        loop {
            let taken = listener.accept().and_then(|(stream, _)| take(stream, &board, port, &busy));
            match taken {
                Ok(()) => is_told = false,
                // Files have run out, say. They come back as connections end, so that this ends nothing.
                Err(error) => {
                    if !is_told {
                        tell(format!("the page cannot be served right now: {error}; it is tried again"));
                    }
                    is_told = true;
                    thread::sleep(RETRY);
                }
            }
        }
    };
    thread::Builder::new().name("server".into()).spawn(listen).map_err(taken)?;
    Ok(format!("http://{}:{port}/", Ipv4Addr::LOCALHOST))
}

/// Answers a connection in a thread of its own, unless there are too many; `busy` is held as often as there are.
fn take(mut stream: TcpStream, board: &Arc<Board>, port: u16, busy: &Arc<()>) -> io::Result<()> {
    stream.set_write_timeout(Some(PATIENCE))?;
    if Arc::strong_count(busy) > CONNECTIONS_MAX {
        // Short enough to wait for nobody. One that went away is no failure.
        let _ = stream.write_all(&Answer::refusal(503, "too many connections at once").to_bytes());
        return Ok(());
    }
    let (board, held) = (board.clone(), busy.clone());
    let converse = move || {
        let answer = match read_head(&mut stream) {
            Ok(head) => match Request::parse(&head) {
                Some(request) => answer(&request, &board, port),
                None => Answer::refusal(400, "this is no request"),
            },
            Err(Unread::TooLong) => Answer::refusal(431, "the head of the request is too long"),
            // Nobody is left to be told.
            Err(Unread::Gone) => return,
        };
        // A page that went away is no failure.
        let _ = stream.write_all(&answer.to_bytes());
        drop(held);
    };
    thread::Builder::new().name("page".into()).spawn(converse).map(drop)
}

/// Why there is no request.
enum Unread {
    TooLong,
    Gone,
}

/// The head of a request, up to the empty line; of what comes after it nothing is read. All of it must come soon.
fn read_head(stream: &mut TcpStream) -> Result<Vec<u8>, Unread> {
    let deadline = Instant::now() + PATIENCE;
    let mut head = Vec::new();
    let mut piece = [0; 2048];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        // No time at all would be as much as there is.
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Err(Unread::Gone);
        }
        let count = match stream.read(&mut piece) {
            Ok(0) | Err(_) => return Err(Unread::Gone),
            Ok(count) => count,
        };
        // The end may lie across two pieces.
        let start = head.len().saturating_sub(3);
        head.extend_from_slice(&piece[..count]);
        if head[start..].windows(4).any(|bytes| bytes == b"\r\n\r\n") {
            return Ok(head);
        }
        if head.len() > HEAD_MAX {
            return Err(Unread::TooLong);
        }
    }
}

/// What is asked for.
struct Request {
    method: String,
    address: String,
    headers: Vec<(String, String)>,
}

impl Request {
    /// `None` where it is no request of HTTP.
    fn parse(head: &[u8]) -> Option<Self> {
        let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
        let mut request = httparse::Request::new(&mut headers);
        request.parse(head).ok().filter(httparse::Status::is_complete)?;
        // What is no text is taken for what it looks like, which is nothing that is allowed.
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let headers = request.headers.iter().map(|header| (header.name.to_string(), text(header.value))).collect();
        Some(Self { method: request.method?.into(), address: request.path?.into(), headers })
    }

    fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(own, _)| own.eq_ignore_ascii_case(name)).map(|(_, value)| value.as_str())
    }
}

struct Answer {
    status: u16,
    kind: &'static str,
    body: Vec<u8>,
    more: Vec<(&'static str, String)>,
}

impl Answer {
    fn ok(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self { status: 200, kind, body: body.into(), more: Vec::new() }
    }

    fn json(value: &Value) -> Self {
        Self::ok("application/json", value.to_string())
    }

    fn refusal(status: u16, why: &str) -> Self {
        Self { status, ..Self::ok("text/plain; charset=utf-8", why) }
    }

    /// As it is sent. Each connection is for one request, so that none is kept open for nothing.
    fn to_bytes(&self) -> Vec<u8> {
        let own = [
            ("Content-Type", self.kind.to_string()),
            ("Content-Length", self.body.len().to_string()),
            ("Connection", "close".into()),
            ("Cache-Control", "no-store".into()),
            ("X-Content-Type-Options", "nosniff".into()),
            ("Cross-Origin-Resource-Policy", "same-origin".into()),
            ("Referrer-Policy", "no-referrer".into()),
            ("Content-Security-Policy", POLICY.into()),
        ];
        // The words after the number are for nobody.
        let mut text = format!("HTTP/1.1 {} -\r\n", self.status);
        for (name, value) in own.iter().chain(&self.more) {
            text += &format!("{name}: {value}\r\n");
        }
        [text.as_bytes(), b"\r\n", &self.body].concat()
    }
}

/// Whether a request comes from our own page, or from no page at all.
fn refuse_strangers(request: &Request, port: u16) -> Result<(), Answer> {
    let hosts = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let own_host = request.header("Host").is_some_and(|host| hosts.iter().any(|own| host.eq_ignore_ascii_case(own)));
    if !own_host {
        return Err(Answer::refusal(403, "this page is served to http://127.0.0.1 and http://localhost alone"));
    }
    let is_own = |origin: &str| hosts.iter().any(|own| origin.eq_ignore_ascii_case(&format!("http://{own}")));
    let is_elsewhere = request.header("Origin").is_some_and(|origin| !is_own(origin));
    let is_foreign = request.header("Sec-Fetch-Site").is_some_and(|site| !["same-origin", "none"].contains(&site));
    if is_elsewhere || is_foreign {
        return Err(Answer::refusal(403, "requests of other pages are not answered"));
    }
    Ok(())
}

fn answer(request: &Request, board: &Board, port: u16) -> Answer {
    if let Err(refusal) = refuse_strangers(request, port) {
        return refusal;
    }
    let address = request.address.as_str();
    if address.len() > ADDRESS_MAX {
        return Answer::refusal(414, "the address is too long");
    }
    let (path, query) = address.split_once('?').unwrap_or((address, ""));
    let query = Query(query);
    match (request.method.as_str(), path) {
        ("GET", "/") => Answer::ok("text/html; charset=utf-8", PAGE),
        ("GET", "/page.css") => Answer::ok("text/css; charset=utf-8", STYLE),
        ("GET", "/page.js") => Answer::ok("text/javascript; charset=utf-8", SCRIPT),
        ("GET", "/status") => {
            let status = board.status_after(query.number("after").unwrap_or(0), PATIENCE);
            Answer::json(&json!(status))
        }
        ("GET", "/pixels") => pixels(board, &query),
        ("GET", "/pixel") => pixel(board, &query),
        ("GET", "/view") => match view_table::on_page().find(|view| query.text("name") == Some(view.name())) {
            Some(view) => Answer::ok("application/octet-stream", view_table::table(view)),
            None => Answer::refusal(404, "there is no such view; /status lists them"),
        },
        ("POST", "/frame") => match query.number("number") {
            Some(frame) => {
                board.wish_frame(frame);
                Answer::json(&json!({}))
            }
            None => Answer::refusal(400, "write /frame?number=N"),
        },
        ("POST", "/crop") => crop(board, &query),
        ("GET" | "POST", _) => Answer::refusal(404, "there is no such page"),
        _ => Answer::refusal(405, "GET and POST are answered"),
    }
}

/// What stands after the question mark.
struct Query<'a>(&'a str);

impl<'a> Query<'a> {
    fn text(&self, name: &str) -> Option<&'a str> {
        self.0.split('&').find_map(|pair| pair.split_once('=').filter(|(key, _)| *key == name).map(|(_, value)| value))
    }

    fn number<T: std::str::FromStr>(&self, name: &str) -> Option<T> {
        self.text(name)?.parse().ok()
    }
}

/// A layer of the whole picture: for each pixel its channels, single precision, little-endian.
fn pixels(board: &Board, query: &Query) -> Answer {
    board.look(|status, picture| {
        let Some(layer) = query.number("layer").and_then(|i: usize| picture.layers.get(i)) else {
            return Answer::refusal(404, "there is no such layer; /status lists them");
        };
        let numbers = picture.part(layer, PixelBounds::whole(picture.resolution));
        let mut body =
            Vec::with_capacity(4 * layer.channels.len() * picture.data.len() / picture.channel_count().max(1));
        numbers.for_each(|x| body.extend_from_slice(&x.to_le_bytes()));
        let [width, height] = picture.resolution;
        let more = vec![
            ("X-Picture", status.picture.to_string()),
            ("X-Size", format!("{width} {height} {}", layer.channels.len())),
        ];
        Answer { more, ..Answer::ok("application/octet-stream", body) }
    })
}

/// All channels of a pixel, as text: JSON knows no infinity.
fn pixel(board: &Board, query: &Query) -> Answer {
    let (Some(x), Some(y)) = (query.number("x"), query.number("y")) else {
        return Answer::refusal(400, "write /pixel?x=X&y=Y");
    };
    board.look(|status, picture| {
        let values = picture.pixel([x, y]);
        let names = picture.channels().into_iter();
        let channels: Map<String, Value> = names.zip(values).map(|(name, x)| (name, x.to_string().into())).collect();
        Answer::json(&json!({"picture": status.picture, "channels": channels}))
    })
}

fn crop(board: &Board, query: &Query) -> Answer {
    let edge = |name| query.number::<i32>(name);
    match (edge("x0"), edge("y0"), edge("x1"), edge("y1")) {
        (None, None, None, None) => board.wish_crop(None),
        (Some(x0), Some(y0), Some(x1), Some(y1)) if x0 < x1 && y0 < y1 => {
            board.wish_crop(Some(PixelBounds { x0, y0, x1, y1 }));
        }
        _ => {
            return Answer::refusal(
                400,
                "write /crop?x0=..&y0=..&x1=..&y1=.. with x0 < x1 and y0 < y1, or /crop alone",
            );
        }
    }
    Answer::json(&json!({}))
}
