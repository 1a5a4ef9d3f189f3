//! Looking on while a scene changes: what the board says, who may read it, and what a viewer is sent.

#[path = "support/http.rs"]
mod http;

use curlsmoke::pipeline;
use curlsmoke::progress::Silent;
use curlsmoke::render::film::PixelBounds;
use curlsmoke::scene::Scene;
use curlsmoke::watch::board::{Board, Picture, Status};
use curlsmoke::watch::tev::Tev;
use curlsmoke::watch::{Event, Watch, server};
use http::{Reply, request};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

const SCENE: &str = "\
version: 1
frames: {first: 1, last: 3}
camera: {position: [0, 0, 4], look_at: [0, 0, 0]}
film: {resolution: [24, 16], spp: 4}
shapes:
  ball: {sphere: {center: [0, 0, 0], radius: 1}, material: {diffuse: {reflectance: [0.5, 0.5, 0.5]}}}
lights:
  - environment: {radiance: [1, 1, 1]}
output: {aovs: [depth, normal]}
";

/// A scene that is watched and served.
struct Desk {
    folder: tempfile::TempDir,
    board: Arc<Board>,
    port: u16,
    events: Arc<Mutex<Vec<Event>>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Desk {
    fn new(scene: &str, viewer: Option<Tev>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (board, events) = (Arc::new(Board::new(None)), Arc::new(Mutex::new(Vec::new())));
        let url = server::serve(&board, 0, |_| ()).unwrap();
        let port = url.trim_end_matches('/').rsplit(':').next().unwrap().parse().unwrap();
        let mut desk = Self { folder, board, port, events, is_over: Arc::default(), thread: None };
        desk.save(scene);
        let (path, board, events, is_over) =
            (desk.path(), desk.board.clone(), desk.events.clone(), desk.is_over.clone());
        desk.thread = Some(thread::spawn(move || {
            let watch = Watch {
                path: &path,
                load: &|| Ok(Scene::load(&path)?),
                crop: &|_| Ok(None),
                board: &board,
                show: &|picture| viewer.iter().for_each(|viewer| viewer.show(picture)),
                is_stopped: &|| is_over.load(Ordering::Relaxed),
                tell: &|event| events.lock().unwrap().push(event.clone()),
            };
            watch.run().unwrap();
        }));
        desk
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("scene.yaml")
    }

    /// As editors save.
    fn save(&self, text: &str) {
        let new = self.folder.path().join(".scene.yaml.swp");
        fs::write(&new, text).unwrap();
        fs::rename(new, self.path()).unwrap();
    }

    /// Waits for the board to say what is demanded.
    #[track_caller]
    fn until(&self, demanded: impl Fn(&Status) -> bool) -> Status {
        let start = Instant::now();
        let mut status = self.board.status_after(0, Duration::ZERO);
        while !demanded(&status) {
            assert!(start.elapsed() < Duration::from_secs(60), "{status:?}");
            status = self.board.status_after(status.version, Duration::from_secs(1));
        }
        status
    }

    fn picture(&self) -> Picture {
        self.board.look(|_, picture| picture.clone())
    }

    fn get(&self, path: &str) -> Reply {
        request(self.port, "GET", path, &[], "")
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// The picture as a fresh start has it.
fn fresh(scene: &Scene, frame: i32) -> Vec<f32> {
    let film = pipeline::film(scene, frame, None, &Silent).unwrap();
    let further = film.layer_data.len() / film.pixels.len();
    let pixels = film.pixels.iter().zip(film.layer_data.chunks(further));
    pixels
        .flat_map(|(p, more)| [p.mean.x, p.mean.y, p.mean.z, p.alpha].into_iter().chain(more.iter().copied()))
        .collect()
}

#[test]
fn saving_shows_a_new_picture_and_errors_leave_the_last_one() {
    let desk = Desk::new(SCENE, None);
    let first = desk.until(|status| status.activity == "done");
    assert_eq!((first.paths, first.resolution, first.frame, first.last), (4, [24, 16], 1, 3));
    assert_eq!(first.layers.iter().map(|layer| layer.name.as_str()).collect::<Vec<_>>(), ["beauty", "Z", "N"]);
    assert_eq!(desk.picture().data, fresh(&Scene::load(&desk.path()).unwrap(), 1));

    desk.save(&SCENE.replace("[1, 1, 1]", "[2, 1, 0.5]"));
    let second = desk.until(|status| status.picture > first.picture && status.activity == "done");
    assert_eq!(second.made, ["lights"]);
    let good = desk.picture();
    assert_eq!(good.data, fresh(&Scene::load(&desk.path()).unwrap(), 1));

    desk.save(&SCENE.replace("radius: 1}", "radios: 1}"));
    let faulty = desk.until(|status| status.activity == "error");
    let problem = faulty.problems.iter().find(|problem| problem.message.contains("radios")).unwrap();
    assert_eq!((problem.severity, problem.line), ("error", Some(6)));
    assert!(problem.message.contains("radios") && problem.excerpt.contains("radios: 1"), "{problem:?}");
    assert_eq!(&problem.excerpt[problem.caret[0]..problem.caret[0] + problem.caret[1]], "radios");
    assert_eq!(desk.picture(), good, "the last good picture stays");
    assert!(desk.events.lock().unwrap().iter().any(|e| matches!(e, Event::Faulty(text) if text.contains("^^^^^^"))));

    // A file that is not there yet.
    desk.save(&SCENE.replace("sphere: {center: [0, 0, 0], radius: 1}", "mesh: {file: late.obj}"));
    desk.until(|status| status.problems.iter().any(|p| p.message.contains("late.obj")));
    fs::write(desk.folder.path().join("late.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let last = desk.until(|status| status.activity == "done" && status.picture > second.picture);
    assert!(last.problems.iter().all(|problem| problem.severity == "warning"));
    // And one that a scene reads.
    fs::write(desk.folder.path().join("late.obj"), "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let status = desk.until(|status| status.activity == "done" && status.picture > last.picture);
    assert_eq!(status.made, ["shapes", "surfaces"]);
}

#[test]
fn a_change_interrupts_what_takes_long() {
    // Hours of paths.
    let desk = Desk::new(&SCENE.replace("spp: 4", "spp: 1000000"), None);
    let status = desk.until(|status| status.paths >= 4);
    assert_eq!(status.activity, "render");
    let start = Instant::now();
    desk.save(SCENE);
    desk.until(|status| status.activity == "done" && status.spp == 4);
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
}

#[test]
fn frames_crops_and_pixels_over_the_wire() {
    let desk = Desk::new(SCENE, None);
    let first = desk.until(|status| status.activity == "done");
    let scene = Scene::load(&desk.path()).unwrap();
    let whole = fresh(&scene, 1);
    // Layer by layer, bit by bit.
    for (i, layer) in first.layers.iter().enumerate() {
        let reply = desk.get(&format!("/pixels?layer={i}"));
        assert_eq!(reply.header("X-Size"), Some(&*format!("24 16 {}", layer.channels.len())));
        let numbers: Vec<u32> = reply.body.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
        let own = |pixel: &[f32]| pixel[layer.first..layer.first + layer.channels.len()].to_vec();
        let expected: Vec<u32> = whole.chunks(8).flat_map(own).map(f32::to_bits).collect();
        assert_eq!(numbers, expected, "{}", layer.name);
    }
    let pixel = desk.get("/pixel?x=0&y=0").json();
    assert_eq!((&pixel["channels"]["Z"], &pixel["channels"]["R"]), (&"inf".into(), &"1".into()));
    let middle = desk.get("/pixel?x=12&y=8").json();
    assert!(middle["channels"]["Z"].as_str().unwrap().starts_with("3.0"), "{middle}");

    assert_eq!(request(desk.port, "POST", "/frame?number=2", &[], "").status, 200);
    let second = desk.until(|status| status.frame == 2 && status.activity == "done");
    assert_eq!(desk.picture().data, fresh(&scene, 2));
    assert!(second.made.is_empty(), "{:?}", second.made);

    // A part anew: what is beyond it stays.
    let crop = "/crop?x0=3&y0=2&x1=9&y1=7";
    assert_eq!(request(desk.port, "POST", crop, &[], "").status, 200);
    desk.until(|status| status.crop == Some([3, 2, 9, 7]) && status.activity == "done");
    request(desk.port, "POST", "/frame?number=3", &[], "");
    desk.until(|status| status.frame == 3 && status.activity == "done");
    let (picture, old, new) = (desk.picture(), fresh(&scene, 2), fresh(&scene, 3));
    for (i, pixel) in picture.data.chunks(8).enumerate() {
        let is_inside = PixelBounds { x0: 3, y0: 2, x1: 9, y1: 7 }.contains(i as i32 % 24, i as i32 / 24);
        assert_eq!(pixel, &(if is_inside { &new } else { &old })[8 * i..8 * i + 8], "pixel {i}");
    }
    request(desk.port, "POST", "/crop", &[], "");
    desk.until(|status| status.crop.is_none() && status.activity == "done");
    assert_eq!(desk.picture().data, new);

    // A frame that there is not is the nearest.
    request(desk.port, "POST", "/frame?number=99", &[], "");
    thread::sleep(Duration::from_millis(200));
    assert_eq!(desk.until(|status| status.activity == "done").frame, 3);
}

#[test]
fn strangers_read_nothing() {
    let desk = Desk::new(SCENE, None);
    let (port, get) = (desk.port, |path: &str, headers: &[(&str, &str)]| request(desk.port, "GET", path, headers, ""));
    let own = format!("http://127.0.0.1:{port}");
    for path in ["/", "/page.css", "/page.js", "/status", "/view?name=neutral"] {
        let reply = get(path, &[("Origin", &own), ("Sec-Fetch-Site", "same-origin")]);
        assert_eq!(reply.status, 200, "{path}");
        assert_eq!(reply.header("Access-Control-Allow-Origin"), None);
        assert!(reply.header("Content-Security-Policy").unwrap().contains("default-src 'none'"));
    }
    assert_eq!(get("/status", &[("Host", &format!("LOCALHOST:{port}"))]).status, 200);
    let foreign: [&[(&str, &str)]; 8] = [
        // A name of somebody else's that was given this machine's address.
        &[("Host", &format!("evil.example:{port}"))],
        &[("Host", "127.0.0.1")],
        &[("Host", "127.0.0.1:1")],
        &[("Host", "")],
        &[("Origin", "http://evil.example")],
        &[("Origin", "null")],
        &[("Origin", &format!("http://localhost:{port}.evil.example"))],
        &[("Sec-Fetch-Site", "cross-site")],
    ];
    for headers in foreign {
        for (method, path) in
            [("GET", "/"), ("GET", "/status"), ("GET", "/pixels?layer=0"), ("POST", "/frame?number=2")]
        {
            let reply = request(port, method, path, headers, "");
            assert_eq!(reply.status, 403, "{headers:?} {path}");
            assert!(!reply.body.starts_with(b"{"), "{headers:?}");
        }
    }
    assert_eq!(desk.board.wishes().frame, None, "no wish of a stranger counts");
    // Nonsense.
    let long = format!("/status?after={}", "9".repeat(2000));
    let bad = [
        ("/nothing", 404),
        ("/pixels", 404),
        ("/pixels?layer=99", 404),
        ("/pixel?x=a", 400),
        ("/view?name=x", 404),
        (&long, 414),
    ];
    for (path, status) in bad {
        assert_eq!(get(path, &[]).status, status, "{path}");
    }
    assert_eq!(request(port, "POST", "/crop?x0=5&y0=0&x1=5&y1=9", &[], "").status, 400);
    assert_eq!(request(port, "DELETE", "/", &[], "").status, 405);
    assert!(server::serve(&desk.board, port, |_| ()).unwrap_err().to_string().contains("another port"));
}

/// Resident memory of a process [bytes].
fn resident(id: u32) -> u64 {
    let pages = fs::read_to_string(format!("/proc/{id}/statm")).unwrap();
    4096 * pages.split(' ').nth(1).unwrap().parse::<u64>().unwrap()
}

/// Starts `watch` in a shell that runs `limits` first; the process, and the port of its page.
fn start(folder: &std::path::Path, limits: &str) -> (Child, u16) {
    fs::write(folder.join("scene.yaml"), SCENE).unwrap();
    let script = format!("{limits} exec \"$0\" watch scene.yaml --serve 0 -j 1");
    let mut child = Command::new("bash")
        .args(["-c", &script, env!("CARGO_BIN_EXE_curlsmoke")])
        .current_dir(folder)
        .stdout(Stdio::piped())
        .stderr(fs::File::create(folder.join("log")).unwrap())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let port = line.trim().trim_end_matches('/').rsplit(':').next().unwrap().parse().unwrap();
    (child, port)
}

#[test]
fn the_page_outlives_floods_and_files_that_run_out() {
    let folder = tempfile::tempdir().unwrap();
    let (mut child, port) = start(folder.path(), "ulimit -n 40;");
    let connect = || TcpStream::connect(("127.0.0.1", port)).unwrap();
    // More than there may be files open.
    let idle: Vec<TcpStream> = (0..60).map(|_| connect()).collect();
    let log = || fs::read_to_string(folder.path().join("log")).unwrap();
    let begin = Instant::now();
    while !log().contains("cannot be served right now") {
        assert!(begin.elapsed() < Duration::from_secs(30), "files never ran out: {}", log());
        thread::sleep(Duration::from_millis(50));
    }
    drop(idle);
    assert_eq!(request(port, "GET", "/status", &[], "").status, 200);
    // Such as say nothing are closed by themselves.
    let mut silent = connect();
    silent.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    assert_eq!(silent.read(&mut [0]).unwrap(), 0);
    // A head without end.
    let before = resident(child.id());
    let mut endless = connect();
    endless.write_all(b"GET / HTTP/1.1\r\nX: ").unwrap();
    let piece = vec![b'a'; 1 << 20];
    let refused = (0..300).any(|_| endless.write_all(&piece).is_err());
    assert!(refused, "300 MB were taken");
    assert!(resident(child.id()) < before + (16 << 20), "{before} {}", resident(child.id()));
    assert_eq!(request(port, "GET", "/", &[], "").status, 200);
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn no_more_connections_than_there_may_be() {
    let desk = Desk::new(SCENE, None);
    let idle: Vec<TcpStream> = (0..48).map(|_| TcpStream::connect(("127.0.0.1", desk.port)).unwrap()).collect();
    // Before anything is asked.
    let refused = || {
        let mut stream = TcpStream::connect(("127.0.0.1", desk.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(500))).unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).is_ok_and(|()| start == *b"HTTP/1.1 503")
    };
    assert!(refused());
    drop(idle);
    let begin = Instant::now();
    while refused() {
        assert!(begin.elapsed() < Duration::from_secs(30), "it never recovers");
    }
    assert_eq!(desk.get("/status").status, 200);
    assert_eq!(desk.get("/ /").status, 400);
}

#[test]
fn a_signal_ends_it_with_its_number() {
    for (name, code) in [("INT", 130), ("TERM", 143)] {
        let folder = tempfile::tempdir().unwrap();
        let (mut child, _port) = start(folder.path(), "");
        assert!(Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), Some(code), "{name}");
    }
}

/// A packet of tev's protocol, as its description says: length, kind, and what belongs to it.
struct Packet {
    kind: u8,
    bytes: Vec<u8>,
    at: usize,
}

impl Packet {
    fn read(stream: &mut impl Read) -> Option<Self> {
        let mut length = [0; 4];
        stream.read_exact(&mut length).ok()?;
        let mut bytes = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut bytes).unwrap();
        Some(Self { kind: bytes[0], bytes, at: 1 })
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        self.at += N;
        self.bytes[self.at - N..self.at].try_into().unwrap()
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn text(&mut self) -> String {
        let length = self.bytes[self.at..].iter().position(|b| *b == 0).unwrap();
        self.at += length + 1;
        String::from_utf8(self.bytes[self.at - length - 1..self.at - 1].to_vec()).unwrap()
    }

    fn texts(&mut self) -> Vec<String> {
        (0..self.u32()).map(|_| self.text()).collect()
    }
}

/// The picture that packets describe, channel by channel, until `is_whole` of it and its channels.
fn receive(
    listener: &TcpListener,
    is_whole: impl Fn(&[Vec<f32>], &[String]) -> bool,
) -> (String, Vec<Vec<f32>>, Vec<String>) {
    let (mut stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let (mut name, mut size, mut channels, mut planes) = (String::new(), [0; 2], Vec::new(), Vec::new());
    while let Some(mut packet) = Packet::read(&mut stream) {
        let [_grab_focus] = packet.take();
        let image = packet.text();
        match packet.kind {
            4 => {
                name = image;
                size = [packet.u32(), packet.u32()];
                channels = packet.texts();
                planes = vec![vec![0.0; (size[0] * size[1]) as usize]; channels.len()];
            }
            6 => {
                assert_eq!(image, name);
                assert_eq!(packet.texts(), channels);
                let [x, y, width, height] = std::array::from_fn(|_| packet.u32());
                let mut list = || channels.iter().map(|_| u64::from_le_bytes(packet.take())).collect::<Vec<_>>();
                let (offsets, strides) = (list(), list());
                let data: Vec<f32> =
                    packet.bytes[packet.at..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
                for (c, plane) in planes.iter_mut().enumerate() {
                    for i in 0..width * height {
                        let place = (y + i / width) * size[0] + x + i % width;
                        plane[place as usize] = data[(offsets[c] + strides[c] * u64::from(i)) as usize];
                    }
                }
                if is_whole(&planes, &channels) {
                    break;
                }
            }
            kind => panic!("a packet of kind {kind}"),
        }
    }
    (name, planes, channels)
}

#[test]
fn tev_is_sent_all_channels_and_may_come_late_and_go() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let notes = Arc::new(Mutex::new(Vec::new()));
    let told = notes.clone();
    let viewer =
        Tev::start(address.to_string(), "scene.yaml".into(), move |text| told.lock().unwrap().push(text)).unwrap();
    let desk = Desk::new(SCENE, Some(viewer));
    desk.until(|status| status.activity == "done");
    let start = Instant::now();
    while notes.lock().unwrap().is_empty() {
        assert!(start.elapsed() < Duration::from_secs(30), "nobody said that the viewer is not there");
        thread::sleep(Duration::from_millis(20));
    }
    // Now it comes.
    let listener = TcpListener::bind(address).unwrap();
    let whole = fresh(&Scene::load(&desk.path()).unwrap(), 1);
    let plane = |data: &[f32], c: usize| data.iter().skip(c).step_by(8).copied().collect::<Vec<f32>>();
    let (name, planes, channels) = receive(&listener, |planes, _| planes[0] == plane(&whole, 0));
    assert_eq!((name.as_str(), channels.join(" ")), ("scene.yaml", "R G B A Z N.X N.Y N.Z".to_string()));
    (0..8).for_each(|c| assert_eq!(planes[c], plane(&whole, c), "{}", channels[c]));
    // The viewer has gone and comes again, while the picture changes its size.
    desk.save(&SCENE.replace("[24, 16]", "[20, 10]"));
    let (_, planes, _) = receive(&listener, |planes, _| planes[0].len() == 200 && planes[3].iter().any(|a| *a > 0.0));
    assert_eq!(planes.len(), 8);
}
