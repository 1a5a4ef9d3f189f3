//! The page of `curlsmoke watch` in a real browser: `make test-page` installs what it needs.

#[path = "support/http.rs"]
mod http;
#[path = "support/program.rs"]
mod program;

use curlsmoke::output::View;
use curlsmoke::output::view::on_screen;
use http::request;
use program::{Folder, SMOKE};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

const SCENE: &str = "\
version: 1
frames: {first: 1, last: 3}
camera: {position: [0, 0, 4], look_at: [0, 0, 0]}
film: {resolution: [48, 32], spp: 4}
shapes:
  ball: {sphere: {center: [0, 0, 0], radius: 1}, material: {diffuse: {reflectance: [0.5, 0.3, 0.1]}}}
lights:
  - environment: {radiance: [0.4, 0.5, 0.6]}
output: {aovs: [depth, normal, albedo, motion, samples]}
";

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a program and reads its standard output up to a line that `find` takes something from.
fn start<T>(command: &mut Command, find: impl Fn(&str) -> Option<T>) -> (Running, T) {
    let name = format!("{command:?}");
    let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
    let mut running = Running(child.unwrap_or_else(|e| panic!("{name}: {e}")));
    let mut lines = BufReader::new(running.0.stdout.take().unwrap()).lines();
    let found = lines.find_map(|line| find(&line.unwrap())).unwrap_or_else(|| panic!("{name} ended early"));
    // So that it never waits for a reader.
    thread::spawn(move || lines.for_each(drop));
    (running, found)
}

/// A browser, driven by the WebDriver protocol.
struct Browser {
    port: u16,
    session: String,
    _driver: Running,
    _profile: tempfile::TempDir,
}

impl Browser {
    fn new(size: [u32; 2]) -> Self {
        let digits = |line: &str| line.split("successfully on port ").nth(1)?.trim_end_matches('.').parse::<u16>().ok();
        let (driver, port) = start(Command::new("chromedriver").arg("--port=0"), digits);
        let profile = tempfile::tempdir().unwrap();
        let flags = [
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-unsafe-swiftshader",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--force-device-scale-factor=1",
            &format!("--window-size={},{}", size[0], size[1]),
            &format!("--user-data-dir={}", profile.path().display()),
        ];
        let wanted = json!({"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": {"args": flags}, "goog:loggingPrefs": {"browser": "ALL"},
        }}});
        let mut browser = Self { port, session: String::new(), _driver: driver, _profile: profile };
        let session = browser.call("POST", "/session", &wanted);
        browser.session = format!("/session/{}", session["sessionId"].as_str().unwrap());
        browser
    }

    fn call(&self, method: &str, path: &str, body: &Value) -> Value {
        let body = if ["GET", "DELETE"].contains(&method) { String::new() } else { body.to_string() };
        let host = format!("localhost:{}", self.port);
        let headers = [("Host", host.as_str()), ("Content-Type", "application/json")];
        let reply = request(self.port, method, &format!("{}{path}", self.session), &headers, &body);
        assert_eq!(reply.status, 200, "{path}: {}", String::from_utf8_lossy(&reply.body));
        reply.json()["value"].clone()
    }

    fn open(&self, url: &str) {
        self.call("POST", "/url", &json!({"url": url}));
    }

    /// What a script returns, or what its promise becomes.
    fn run(&self, script: &str) -> Value {
        self.call("POST", "/execute/sync", &json!({"script": script, "args": []}))
    }

    #[track_caller]
    fn until(&self, condition: &str) {
        let start = Instant::now();
        while self.run(&format!("return !!({condition})")) != json!(true) {
            if start.elapsed() > Duration::from_secs(90) {
                let state = self.run("return [status, layerName, viewName, exposure, document.body.innerText]");
                panic!("{condition} never came true: {state:#}");
            }
            thread::sleep(Duration::from_millis(50));
        }
    }

    fn key(&self, key: &str) {
        let actions = json!([{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]);
        self.call("POST", "/actions", &json!({"actions": [{"type": "key", "id": "keys", "actions": actions}]}));
    }

    /// Moves the pointer to the middles of pixels of the picture, with the button held from the first to the last if `drags`.
    fn point(&self, pixels: &[[u32; 2]], drags: bool) {
        let mut actions = Vec::new();
        for (i, [x, y]) in pixels.iter().enumerate() {
            let script = format!(
                "const p = placed(), b = stage.getBoundingClientRect(); \
                return [b.left + p.x + ({x} + .5) * p.scale, b.top + p.y + ({y} + .5) * p.scale].map(Math.round)"
            );
            let place = self.run(&script);
            actions.push(json!({"type": "pointerMove", "duration": 30, "x": place[0], "y": place[1]}));
            if drags && i == 0 {
                actions.push(json!({"type": "pointerDown", "button": 0}));
            }
        }
        if drags {
            actions.push(json!({"type": "pointerUp", "button": 0}));
        }
        let pointer =
            json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions});
        self.call("POST", "/actions", &json!({"actions": [pointer]}));
    }

    /// What the screen shows of a pixel of the picture.
    fn shown(&self, [x, y]: [u32; 2]) -> [i64; 3] {
        let script = format!(
            "const c = document.createElement('canvas'); [c.width, c.height] = [developed.width, developed.height]; \
            const s = c.getContext('2d'); s.drawImage(developed, 0, 0); return [...s.getImageData({x}, {y}, 1, 1).data]"
        );
        let color = self.run(&script);
        std::array::from_fn(|i| color[i].as_i64().unwrap())
    }

    fn screenshot(&self) -> Vec<u8> {
        let text = self.call("GET", "/screenshot", &Value::Null);
        base64(text.as_str().unwrap())
    }

    /// What went wrong, by the browser's own account.
    fn complaints(&self) -> Vec<String> {
        let log = self.call("POST", "/se/log", &json!({"type": "browser"}));
        let severe = log.as_array().unwrap().iter().filter(|entry| entry["level"] == "SEVERE");
        severe.map(|entry| entry["message"].to_string()).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        if !thread::panicking() {
            self.call("DELETE", "", &Value::Null);
        }
    }
}

fn base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let value = |byte: u8| DIGITS.iter().position(|digit| *digit == byte);
    let digits: Vec<usize> = text.bytes().filter_map(value).collect();
    let three = |four: &[usize]| {
        let bits = four.iter().enumerate().fold(0, |bits, (i, digit)| bits | digit << (18 - 6 * i));
        [bits >> 16, bits >> 8, bits].map(|byte| byte as u8).into_iter().take(four.len() - 1).collect::<Vec<u8>>()
    };
    digits.chunks(4).flat_map(three).collect()
}

fn watch(folder: &Folder, arguments: &[&str]) -> (Running, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_curlsmoke"));
    command.current_dir(folder.0.path()).arg("watch").args(arguments).args(["--serve", "0"]);
    start(&mut command, |line| line.starts_with("http://127.0.0.1:").then(|| line.to_string()))
}

/// As editors save.
fn save(folder: &Folder, text: &str) {
    folder.write("new", text);
    std::fs::rename(folder.path("new"), folder.path("scene.yaml")).unwrap();
}

#[track_caller]
fn assert_close(shown: [i64; 3], light: [f32; 3], view: View) {
    let expected = on_screen(view, light).map(|x| (x * 255.0).round() as i64);
    assert!(shown.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1), "{shown:?} instead of {expected:?}");
}

#[test]
#[ignore = "needs a browser: make test-page"]
fn the_page_does_what_it_says() {
    let folder = Folder::new();
    save(&folder, SCENE);
    let (_program, url) = watch(&folder, &["scene.yaml"]);
    let browser = Browser::new([1280, 800]);
    browser.open(&url);
    browser.until("status.activity === 'done' && status.paths === 4 && developed.width === 48");
    let light = |browser: &Browser| -> [f32; 3] {
        let values = browser.run("return [...pixels.data.slice(4 * (16 * 48 + 24), 4 * (16 * 48 + 24) + 3)]");
        std::array::from_fn(|i| values[i].as_f64().unwrap() as f32)
    };
    let middle = light(&browser);
    assert!(middle[0] > 0.1 && middle[0] > middle[2], "{middle:?}");
    assert_close(browser.shown([24, 16]), middle, View::Standard);
    // Exposure and views.
    browser.key("e");
    browser.key("e");
    browser.until("exposure === 1");
    thread::sleep(Duration::from_millis(300));
    assert_close(browser.shown([24, 16]), middle.map(|x| 2.0 * x), View::Standard);
    browser.key("v");
    browser.until("viewName === 'neutral' && tables.size === 2");
    thread::sleep(Duration::from_millis(500));
    assert_close(browser.shown([24, 16]), middle.map(|x| 2.0 * x), View::Neutral);
    browser.key("0");
    // Both ways to draw give the same.
    let differing = browser.run("return (async () => {
        const gl = document.createElement('canvas'), plain = document.createElement('canvas');
        const developer = glDeveloper(gl);
        if (!developer) return 'no WebGL';
        const table = await tableOf('neutral');
        let worst = 0;
        for (const [way, ramp] of [[0, DATA], [1, LIGHT], [2, DATA], [3, DATA]]) {
            const job = {width: 48, height: 32, count: 4, data: pixels.data, serial: way, way, gain: 1.5, range: [0, 2], table, ramp};
            developer.draw(job); plainDeveloper(plain).draw(job);
            const read = (canvas) => { const c = document.createElement('canvas'); [c.width, c.height] = [48, 32];
                const s = c.getContext('2d'); s.drawImage(canvas, 0, 0); return s.getImageData(0, 0, 48, 32).data; };
            const [a, b] = [read(gl), read(plain)];
            for (let i = 0; i < a.length; i++) worst = Math.max(worst, Math.abs(a[i] - b[i]));
        }
        return worst;
    })()");
    println!("largest difference between WebGL and 2D: {differing}");
    assert!(differing == json!("no WebGL") || differing.as_f64().unwrap() <= 3.0, "{differing}");
    // Layers, false colour and the inspector.
    browser.run("[...document.querySelectorAll('#layers [role=option]')].find((o) => o.textContent === 'Z').click()");
    browser.until("pixels.layer.name === 'Z' && !document.getElementById('legend').hidden");
    browser.key("c");
    browser.until("isFalse");
    browser.key("c");
    browser.run("chooseLayer('beauty')");
    browser.until("pixels.layer.name === 'beauty'");
    browser.point(&[[24, 16]], false);
    browser.until("document.querySelector('#inspector tbody').rows.length === 14");
    let cells = browser.run("return [...document.querySelectorAll('#inspector tr')].map((row) => row.title)");
    let cells: Vec<&str> = cells.as_array().unwrap().iter().map(|cell| cell.as_str().unwrap()).collect();
    assert_eq!(cells[0], format!("R  {}", middle[0]), "{cells:?}");
    assert!(cells[4].starts_with("Z  3.0"), "{cells:?}");
    assert_eq!(browser.run("return document.getElementById('place').textContent"), "24, 16");
    // A crop by dragging, and the whole again.
    browser.point(&[[10, 8], [20, 12], [30, 20]], true);
    browser.until("status.crop && status.activity === 'done'");
    assert_eq!(browser.run("return status.crop"), json!([10, 8, 31, 21]));
    browser.until("!document.getElementById('crop').hidden");
    browser.key("x");
    browser.until("!status.crop && status.activity === 'done'");
    // Frames.
    browser.key("\u{E014}");
    browser.until("status.frame === 2 && status.activity === 'done'");
    // An error keeps the picture and says where.
    save(&folder, &SCENE.replace("radius: 1}", "radios: 1}"));
    browser.until("status.activity === 'error' && !document.getElementById('problems').hidden");
    let text = browser.run("return document.getElementById('problems').innerText");
    let text = text.as_str().unwrap();
    assert!(["scene.yaml:6:38", "radios", "^^^^^^", "did you mean"].iter().all(|part| text.contains(part)), "{text}");
    assert_eq!(browser.run("return pixels.width"), 48);
    // Mended, with other light, which is seen.
    save(&folder, &SCENE.replace("[0.4, 0.5, 0.6]", "[0.8, 0.5, 0.6]"));
    browser.until("status.activity === 'done' && document.getElementById('problems').hidden");
    browser.until("pixels.data[0] > 0.75");
    // Also where there is little room.
    browser.call("POST", "/window/rect", &json!({"width": 900, "height": 620}));
    browser.until("document.documentElement.scrollWidth <= 900");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
#[ignore = "needs a browser: make test-page"]
fn smoke_grows_before_the_eyes() {
    let folder = Folder::new();
    folder.write("scene.yaml", &SMOKE.replace("[16, 16], spp: 4", "[160, 120], spp: 8"));
    let (_program, url) = watch(&folder, &["scene.yaml"]);
    let browser = Browser::new([1280, 800]);
    browser.open(&url);
    browser.until("status.activity === 'done' && status.paths === 8");
    folder.write(
        "scene.yaml",
        &SMOKE.replace("[16, 16], spp: 4", "[160, 120], spp: 8").replace("extinction: 20", "extinction: 5"),
    );
    browser.until("status.activity === 'done' && status.made.join() === 'smoke'");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// docs/watch.png: `make page-picture`.
#[test]
#[ignore = "makes a picture of the documentation: make page-picture"]
fn picture_of_the_page() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let scene = root.join("scenes/plume.yaml");
    let folder = Folder::new();
    let scene = scene.to_str().unwrap();
    let (_program, url) = watch(&folder, &[scene, "--frame", "12", "--resolution", "720x405", "--spp", "24"]);
    let browser = Browser::new([1440, 860]);
    browser.open(&url);
    let start = Instant::now();
    while browser.run("return status.activity === 'done'") != json!(true) {
        assert!(start.elapsed() < Duration::from_secs(1800), "the picture takes too long");
        thread::sleep(Duration::from_secs(1));
    }
    browser.point(&[[390, 190]], true);
    browser.until("pinned && document.querySelector('#inspector tbody').rows.length > 4");
    browser.run("document.activeElement.blur()");
    thread::sleep(Duration::from_secs(1));
    std::fs::write(root.join("docs/watch.png"), browser.screenshot()).unwrap();
}
