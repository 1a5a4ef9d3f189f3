//! The board as a web page, for this machine alone.
//!
//! Only requests that name this machine as their host are answered, so that no page from elsewhere reads the board by giving its own
//! name this machine's address, and none that another page has sent. The page brings all that it needs with it.

use crate::error::Error;
use crate::render::film::PixelBounds;
use crate::watch::board::Board;
use crate::watch::view_table;
use serde_json::{Map, Value, json};
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, Server};

/// The port unless another is wished for.
pub const PORT: u16 = 7640;
/// Longest that a request waits for news.
const PATIENCE: Duration = Duration::from_secs(10);
/// Requests that are answered at once.
const REQUESTS_MAX: usize = 48;
/// Longest address that is read [bytes].
const ADDRESS_MAX: usize = 512;
/// The page loads from its own server alone, and no other page shows it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
                      frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPT: &str = include_str!("page/page.js");

/// Serves the board from now on, in threads of its own; the address of the page.
///
/// # Errors
/// Where the port is taken; 0 takes any that is free.
pub fn serve(board: &Arc<Board>, port: u16) -> Result<String, Error> {
    let taken = |e: &dyn std::fmt::Display| {
        Error::Usage(format!(
            "--serve {port}: the page cannot be served there: {e}; choose another port, or 0 for any that is free"
        ))
    };
    let server = Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(|e| taken(&e))?;
    let port = server.server_addr().to_ip().map_or(port, |address| address.port());
    let (board, busy) = (board.clone(), Arc::new(AtomicUsize::new(0)));
    let listen = move || {
        for request in server.incoming_requests() {
            let (board, busy) = (board.clone(), busy.clone());
            if busy.fetch_add(1, Ordering::Relaxed) >= REQUESTS_MAX {
                busy.fetch_sub(1, Ordering::Relaxed);
                send(request, Answer::refusal(503, "too many requests at once"));
                continue;
            }
            let spawned = thread::Builder::new().name("page".into()).spawn({
                let busy = busy.clone();
                move || {
                    let answer = answer(&request, &board, port);
                    send(request, answer);
                    busy.fetch_sub(1, Ordering::Relaxed);
                }
            });
            if spawned.is_err() {
                busy.fetch_sub(1, Ordering::Relaxed);
            }
        }
    };
    thread::Builder::new().name("server".into()).spawn(listen).map_err(|e| taken(&e))?;
    Ok(format!("http://{}:{port}/", Ipv4Addr::LOCALHOST))
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
}

fn send(request: Request, answer: Answer) {
    let own = [
        ("Content-Type", answer.kind.to_string()),
        ("Cache-Control", "no-store".into()),
        ("X-Content-Type-Options", "nosniff".into()),
        ("Cross-Origin-Resource-Policy", "same-origin".into()),
        ("Referrer-Policy", "no-referrer".into()),
        ("Content-Security-Policy", POLICY.into()),
    ];
    let length = answer.body.len();
    let headers = own.into_iter().chain(answer.more);
    let headers = headers.filter_map(|(name, value)| Header::from_bytes(name, value).ok()).collect();
    let body = io::Cursor::new(answer.body);
    // Its length is known however long it is.
    let response =
        Response::new(answer.status.into(), headers, body, Some(length), None).with_chunked_threshold(usize::MAX);
    // A page that went away is no failure.
    let _ = request.respond(response);
}

fn header<'a>(request: &'a Request, name: &'static str) -> Option<&'a str> {
    request.headers().iter().find(|header| header.field.equiv(name)).map(|header| header.value.as_str())
}

/// Whether a request comes from our own page, or from no page at all.
fn refuse_strangers(request: &Request, port: u16) -> Result<(), Answer> {
    let hosts = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let own_host = header(request, "Host").is_some_and(|host| hosts.iter().any(|own| host.eq_ignore_ascii_case(own)));
    if !own_host {
        return Err(Answer::refusal(403, "this page is served to http://127.0.0.1 and http://localhost alone"));
    }
    let is_own = |origin: &str| hosts.iter().any(|own| origin.eq_ignore_ascii_case(&format!("http://{own}")));
    let is_elsewhere = header(request, "Origin").is_some_and(|origin| !is_own(origin));
    let is_foreign = header(request, "Sec-Fetch-Site").is_some_and(|site| !["same-origin", "none"].contains(&site));
    if is_elsewhere || is_foreign {
        return Err(Answer::refusal(403, "requests of other pages are not answered"));
    }
    Ok(())
}

fn answer(request: &Request, board: &Board, port: u16) -> Answer {
    if let Err(refusal) = refuse_strangers(request, port) {
        return refusal;
    }
    let address = request.url();
    if address.len() > ADDRESS_MAX {
        return Answer::refusal(414, "the address is too long");
    }
    let (path, query) = address.split_once('?').unwrap_or((address, ""));
    let query = Query(query);
    match (request.method(), path) {
        (Method::Get, "/") => Answer::ok("text/html; charset=utf-8", PAGE),
        (Method::Get, "/page.css") => Answer::ok("text/css; charset=utf-8", STYLE),
        (Method::Get, "/page.js") => Answer::ok("text/javascript; charset=utf-8", SCRIPT),
        (Method::Get, "/status") => {
            let status = board.status_after(query.number("after").unwrap_or(0), PATIENCE);
            Answer::json(&json!(status))
        }
        (Method::Get, "/pixels") => pixels(board, &query),
        (Method::Get, "/pixel") => pixel(board, &query),
        (Method::Get, "/view") => match view_table::on_page().find(|view| query.text("name") == Some(view.name())) {
            Some(view) => Answer::ok("application/octet-stream", view_table::table(view)),
            None => Answer::refusal(404, "there is no such view; /status lists them"),
        },
        (Method::Post, "/frame") => match query.number("number") {
            Some(frame) => {
                board.wish_frame(frame);
                Answer::json(&json!({}))
            }
            None => Answer::refusal(400, "write /frame?number=N"),
        },
        (Method::Post, "/crop") => crop(board, &query),
        (Method::Get | Method::Post, _) => Answer::refusal(404, "there is no such page"),
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
    let edge = |name| query.number::<u32>(name);
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
