//! A page that shows what became of a suite: one file, which asks the network for nothing.

use crate::error::Error;
use crate::output::View;
use crate::output::compare::Finding;
use crate::output::image::Image;
use crate::output::layers::BEAUTY;
use crate::output::png;
use crate::output::{OutputError, heat_map};
use crate::regress::judge::LayerJudgement;
use crate::regress::junit::escaped;
use crate::regress::{CaseResult, Compared};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// A page under way.
#[derive(Debug)]
pub struct HtmlReport {
    title: String,
    cases: Vec<Section>,
}

/// What is shown of a case.
#[derive(Debug)]
struct Section {
    passed: bool,
    html: String,
    seconds: f64,
}

impl HtmlReport {
    /// A page without cases.
    pub fn new(title: &str) -> Self {
        Self { title: title.into(), cases: Vec::new() }
    }

    /// Takes in a case, with its pictures.
    ///
    /// # Errors
    /// When a picture cannot be encoded.
    pub fn add(&mut self, result: &CaseResult) -> Result<(), Error> {
        let html = section(result)?;
        self.cases.push(Section { passed: result.passed(), html, seconds: result.seconds });
        Ok(())
    }

    /// The page, failures first.
    pub fn finish(mut self) -> String {
        self.cases.sort_by_key(|case| case.passed);
        let failed = self.cases.iter().filter(|case| !case.passed).count();
        let (count, seconds) = (self.cases.len(), self.cases.iter().map(|case| case.seconds).sum::<f64>());
        let verdict = match failed {
            0 => format!("<p class=\"verdict pass\">All {count} cases pass</p>"),
            _ => format!("<p class=\"verdict fail\">{failed} of {count} cases fail</p>"),
        };
        let title = escaped(&self.title);
        let body: String = self.cases.into_iter().map(|case| case.html).collect();
        let version = env!("CARGO_PKG_VERSION");
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
             content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header>\n<h1>{title}</h1>\n{verdict}\n<p class=\"about\">curlsmoke {version} · {seconds:.1} s</p>\n<form \
             id=\"filter\">\n<label><input type=\"checkbox\" id=\"failures\"> failures only</label>\n<input type=\"search\" \
             id=\"name\" placeholder=\"name of a case\" aria-label=\"name of a case\">\n<span class=\"keys\">point at a picture \
             for its reference · keys <kbd>1</kbd> new <kbd>2</kbd> reference <kbd>3</kbd> difference <kbd>4</kbd> map</span>\n\
             </form>\n</header>\n<main>\n{body}</main>\n<p id=\"none\" hidden>No case is left.</p>\n<script>\n{SCRIPT}</script>\n\
             </body>\n</html>\n"
        )
    }
}

fn section(result: &CaseResult) -> Result<String, Error> {
    let passed = result.passed();
    let (class, word) = if passed { ("pass", "pass") } else { ("fail", "fail") };
    let open = if passed { "" } else { " open" };
    let name = escaped(&result.name);
    let mut html = format!(
        "<details class=\"case {class}\" data-name=\"{name}\"{open}>\n<summary><span class=\"badge\">{word}</span> <b>{name}</b>\
         <span class=\"line\">{}</span><span class=\"time\">{:.2} s</span></summary>\n",
        escaped(&result.summary()),
        result.seconds
    );
    if result.should_fail {
        html += "<p class=\"note\">A pair that must be told apart: the case fails where the pictures agree.</p>\n";
    }
    for warning in &result.warnings {
        // Writing to a String cannot fail.
        let _ = writeln!(html, "<p class=\"note warning\">Warning: {}</p>", escaped(warning));
    }
    if let Ok(compared) = &result.outcome {
        html += &findings(&compared.judgement.structure);
        for layer in &compared.judgement.layers {
            html += &layer_html(compared, layer)?;
        }
    }
    if !passed && !result.should_fail {
        let _ = writeln!(
            html,
            "<p class=\"accept\">If the change is meant: <code>{}</code></p>",
            escaped(&result.update_command)
        );
    }
    html += "</details>\n";
    Ok(html)
}

fn findings(findings: &[Finding]) -> String {
    if findings.is_empty() {
        return String::new();
    }
    let rows: String = findings
        .iter()
        .map(|f| {
            let (class, word) = if f.passed { ("pass", "pass") } else { ("fail", "fail") };
            let (check, text) = (escaped(f.check), escaped(&f.text));
            format!("<tr class=\"{class}\"><td>{word}</td><th>{check}</th><td>{text}</td></tr>\n")
        })
        .collect();
    format!("<table>\n{rows}</table>\n")
}

/// The pictures of a layer beside what was found.
fn layer_html(compared: &Compared, layer: &LayerJudgement) -> Result<String, Error> {
    let class = if layer.report.passed() { "pass" } else { "fail" };
    let name = escaped(&layer.layer.name);
    let mut html = format!(
        "<section class=\"layer {class}\">\n<h2>{name} <span>{}</span></h2>\n<div class=\"sides\">\n",
        escaped(layer.check)
    );
    let shown = shown(compared, layer)?;
    if !shown.is_empty() {
        let [width, height] = compared.image.data_size;
        html += "<figure class=\"viewer\">\n<div class=\"stack\">\n";
        for (i, picture) in shown.iter().enumerate() {
            let data = STANDARD.encode(&picture.png);
            let hidden = if i == 0 { "" } else { " hidden" };
            let title = escaped(&picture.title);
            let _ = writeln!(
                html,
                "<img width=\"{width}\" height=\"{height}\" alt=\"{title} of {name}\" data-kind=\"{i}\" data-title=\"{title}\" \
                 src=\"data:image/png;base64,{data}\"{hidden}>"
            );
        }
        html += "</div>\n<figcaption>";
        for (i, picture) in shown.iter().enumerate() {
            let pressed = i == 0;
            let word = picture.word;
            let _ =
                write!(html, "<button type=\"button\" data-kind=\"{i}\" aria-pressed=\"{pressed}\">{word}</button>");
        }
        let _ = writeln!(html, "<span class=\"scale\">{}</span></figcaption>\n</figure>", escaped(&shown[0].title));
    }
    html += &findings(&layer.report.findings);
    html += "</div>\n</section>\n";
    Ok(html)
}

/// A picture of the page.
struct Shown {
    word: &'static str,
    title: String,
    png: Vec<u8>,
}

/// How often a difference is brightened, so that what matters can be seen.
const DIFFERENCE_GAIN: f32 = 8.0;

fn shown(compared: &Compared, layer: &LayerJudgement) -> Result<Vec<Shown>, OutputError> {
    let size = compared.image.data_size;
    let colours = |image: &Image| rgb_of(image, layer);
    let (Some(ours), Some(theirs)) = (colours(&compared.image), colours(&compared.reference)) else {
        return Ok(Vec::new());
    };
    let look = Look::of(&theirs, layer.layer.name == BEAUTY || layer.layer.parts == ["R", "G", "B"]);
    let difference: Vec<[f32; 3]> = ours
        .iter()
        .zip(&theirs)
        .map(|(a, b)| std::array::from_fn(|i| DIFFERENCE_GAIN * (a[i] - b[i]).abs() * look.gain))
        .collect();
    let mut all = vec![
        Shown { word: "New", title: look.title("New"), png: look.encode(&ours, size)? },
        Shown { word: "Reference", title: look.title("Reference"), png: look.encode(&theirs, size)? },
        Shown {
            word: "Difference",
            title: format!("Difference, {DIFFERENCE_GAIN} times as bright"),
            png: png::encode(&difference, size, View::Standard, 0.0)?,
        },
    ];
    if !layer.report.map.is_empty() {
        let (png, white) = heat_map::encode_png(&layer.report)?;
        let unit = match layer.check {
            "stat" => "standard deviations",
            "flip" => "of FLIP",
            _ => "of difference",
        };
        all.push(Shown { word: "Map", title: format!("Map, white is {white:.3} {unit} or more"), png });
    }
    Ok(all)
}

/// The layer as colours: three channels as they are, one as grey, two with none in blue.
fn rgb_of(image: &Image, layer: &LayerJudgement) -> Option<Vec<[f32; 3]>> {
    let channels = layer.layer.channels(image)?;
    let part = |c: usize, i: usize| channels.get(c).map_or(0.0, |channel| channel[i]);
    let grey = channels.len() == 1;
    Some((0..image.pixel_count()).map(|i| std::array::from_fn(|c| part(if grey { 0 } else { c }, i))).collect())
}

/// How a layer is put on the screen, the same for both pictures.
struct Look {
    /// Taken off first.
    offset: f32,
    gain: f32,
    view: View,
    text: String,
}

impl Look {
    /// Light gets whole stops of exposure that make the reference about as bright as the screen, data is stretched to the screen's
    /// range.
    fn of(reference: &[[f32; 3]], is_light: bool) -> Self {
        let mut values: Vec<f32> = reference.iter().flatten().copied().filter(|x| x.is_finite()).collect();
        values.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| values.get(((values.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(0.0);
        if is_light {
            let bright = at(0.99);
            let stops = if bright > 0.0 { (0.8 / bright).log2().round().clamp(-30.0, 30.0) } else { 0.0 };
            let text = if stops == 0.0 { String::new() } else { format!(", {stops:+} stops") };
            return Self { offset: 0.0, gain: stops.exp2(), view: View::Standard, text };
        }
        let (low, high) = (at(0.0), at(1.0));
        let gain = if high > low { 1.0 / (high - low) } else { 1.0 };
        Self { offset: low, gain, view: View::Raw, text: format!(", black {low:.3}, white {high:.3}") }
    }

    fn title(&self, word: &str) -> String {
        format!("{word}{}", self.text)
    }

    fn encode(&self, colours: &[[f32; 3]], size: [u32; 2]) -> Result<Vec<u8>, OutputError> {
        let mapped: Vec<[f32; 3]> = colours.iter().map(|c| c.map(|x| (x - self.offset) * self.gain)).collect();
        png::encode(&mapped, size, self.view, 0.0)
    }
}
