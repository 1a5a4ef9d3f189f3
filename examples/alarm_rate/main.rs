//! How often the statistical test calls equal light different, and how often it finds a change of a per cent: measured, on small
//! scenes, with the code that `curlsmoke regress` runs.
//!
//! `make alarm-rate` writes the figures into `docs/regression.md`. `-- SHARE` takes that share of the comparisons, for a try.

use curlsmoke::output::image::Image;
use curlsmoke::progress::Silent;
use curlsmoke::regress::picture::Making;
use curlsmoke::regress::{RegressJob, judge};
use curlsmoke::scene::suite::{Case, PATHS_DEFAULT, Suite};
use std::fmt::Write as _;
use std::path::Path;

/// A scene, and its changes by a per cent.
struct Subject {
    name: &'static str,
    /// Its file, from the folder of this project.
    file: &'static str,
    frame: i32,
    /// Of density, albedo and light.
    changes: [&'static str; 3],
    /// Pictures of each change.
    rounds: usize,
    /// References, and pictures compared with each, of equal light.
    equal: [usize; 2],
    /// Paths a pixel of these; those of the suite's default where there are none.
    equal_spp: Option<u32>,
}

/// Small scenes on which a change of a per cent shows, for rates; fewer paths for equal light than by default, since its rate is
/// what counts and tails are heavier with few. Then an ordinary scene as large as somebody would test it, for what that sees.
const SUBJECTS: [Subject; 4] = [
    Subject {
        name: "wisp",
        file: "examples/alarm_rate/wisp.yaml",
        frame: 1,
        changes: [
            "smoke.medium.extinction=10.1",
            "smoke.medium.albedo=[0.505, 0.505, 0.505]",
            "lights[0].environment.radiance=[1.01, 1.01, 1.01]",
        ],
        rounds: ROUNDS,
        equal: EQUAL,
        equal_spp: Some(EQUAL_SPP),
    },
    Subject {
        name: "haze",
        file: "examples/alarm_rate/haze.yaml",
        frame: 1,
        changes: [
            "volumes.haze.medium.extinction=1.01",
            "volumes.haze.medium.albedo=[0.808, 0.808, 0.808]",
            "lights[0].sun.irradiance=[3.03, 3.03, 3.03]",
        ],
        rounds: ROUNDS,
        equal: EQUAL,
        equal_spp: Some(EQUAL_SPP),
    },
    Subject {
        name: "lamp",
        file: "examples/alarm_rate/lamp.yaml",
        frame: 1,
        changes: [
            "volumes.mist.medium.extinction=0.808",
            "volumes.mist.medium.albedo=[0.808, 0.808, 0.808]",
            "lights[0].point.intensity=[1.01, 1.01, 1.01]",
        ],
        rounds: ROUNDS,
        equal: EQUAL,
        equal_spp: Some(EQUAL_SPP),
    },
    Subject {
        name: "plume",
        file: "scenes/plume.yaml",
        frame: 12,
        changes: [
            "smoke.medium.extinction=60.6",
            "smoke.medium.albedo=[0.9393, 0.9393, 0.9494]",
            "lights[0].sun.irradiance=[7.07, 5.858, 4.444]",
        ],
        rounds: 4,
        equal: [1, 4],
        equal_spp: None,
    },
];

const CHANGES: [&str; 3] = ["density", "albedo", "light"];

/// With 34 pictures of each change of three scenes, 306 and none missed, at least 99 % are found (level 95 %).
const ROUNDS: usize = 34;
/// Each reference is for a few pictures, since its own error is in all of those.
const EQUAL: [usize; 2] = [14, 25];
const EQUAL_SPP: u32 = 64;
/// Paths of a reference for each of the pictures'.
const REFERENCE_FACTOR: u32 = 8;

/// What replaces the figures in the page.
const MARKERS: [&str; 2] = ["<!-- figures of make alarm-rate -->\n", "<!-- end of figures -->\n"];

fn main() {
    let share: f64 = std::env::args().nth(1).map_or(1.0, |text| text.parse().expect("a share of the comparisons"));
    let text = figures(share);
    // The program's own output is the figures.
    print_figures(&text);
    if share >= 1.0 {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/regression.md");
        let page = std::fs::read_to_string(&path).expect("the page is there");
        let (before, rest) = page.split_once(MARKERS[0]).expect("the page has its markers");
        let (_, after) = rest.split_once(MARKERS[1]).expect("the page has its markers");
        std::fs::write(&path, format!("{before}{}{text}{}{after}", MARKERS[0], MARKERS[1])).expect("writable");
    }
}

#[allow(clippy::print_stdout)]
fn print_figures(text: &str) {
    println!("{text}");
}

fn figures(share: f64) -> String {
    let counted = |count: usize| ((count as f64 * share) as usize).max(1);
    let alarms = SUBJECTS.map(|subject| {
        let [references, pictures] = [counted(subject.equal[0]), subject.equal[1]];
        let alarms = equal_alarms(&subject, references);
        let count = references * pictures;
        print_figures(&format!("{}: {alarms} alarms in {count} comparisons of equal light", subject.name));
        [alarms, count]
    });
    let found = changes_found(counted);
    let mut text = String::from(
        "| scene | equal light: alarms | density +1 % | albedo +1 % | light +1 % |\n|---|---|---|---|---|\n",
    );
    for ((subject, [alarms, equal]), found) in SUBJECTS.iter().zip(alarms).zip(found) {
        let _ = write!(text, "| {} | {alarms} of {equal} |", subject.name);
        found.iter().for_each(|found| {
            let _ = write!(text, " {found} of {} |", counted(subject.rounds));
        });
        text += "\n";
    }
    // Rates are those of the scenes that are there for rates.
    let many = || SUBJECTS.iter().enumerate().filter(|(_, subject)| subject.rounds == ROUNDS).map(|(s, _)| s);
    let [all, equal] = [0, 1].map(|i| many().map(|s| alarms[s][i]).sum::<usize>());
    let rate = 100.0 * all as f64 / equal as f64;
    let _ = write!(text, "| wisp, haze, lamp | {all} of {equal}: {rate:.1} % |");
    let count = many().count() * counted(ROUNDS);
    (0..CHANGES.len()).map(|i| many().map(|s| found[s][i]).sum::<usize>()).for_each(|sum| {
        let _ = write!(text, " {sum} of {count} |");
    });
    let (sum, count) = (many().map(|s| found[s].iter().sum::<usize>()).sum::<usize>(), count * CHANGES.len());
    let _ = writeln!(
        text,
        "\n\nIn the three small scenes {sum} of {count} changes were found, so at least {:.1} % are (level 95 %). Equal light there \
         with {EQUAL_SPP} paths a pixel; all else with {:.0} million in the picture, the default; references with \
         {REFERENCE_FACTOR} times as many; 48 × 27 pixels, `plume` its own 480 × 270; `stat` with its defaults.",
        100.0 * least_rate(sum, count),
        PATHS_DEFAULT as f64 / 1e6,
    );
    text
}

/// The rate of which so many of `count` or more are found in 5 % of cases (Clopper and Pearson).
fn least_rate(found: usize, count: usize) -> f64 {
    let at_least = |rate: f64| -> f64 {
        let log_choose = |k: usize| (0..k).map(|i| ((count - i) as f64 / (i + 1) as f64).ln()).sum::<f64>();
        let term = |k: usize| log_choose(k) + k as f64 * rate.ln() + (count - k) as f64 * (-rate).ln_1p();
        (found..=count).map(|k| term(k).exp()).sum()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if at_least(middle) < 0.05 { low = middle } else { high = middle }
    }
    low
}

/// How often each change of each scene is found.
fn changes_found(counted: impl Fn(usize) -> usize) -> [[usize; CHANGES.len()]; SUBJECTS.len()] {
    let references = SUBJECTS.map(|subject| {
        let scene = Scene::new(&subject, None, None);
        scene.picture(Some(scene.default_spp() * REFERENCE_FACTOR), 1)
    });
    let mut found = [[0; CHANGES.len()]; SUBJECTS.len()];
    // Round after round, so that whoever cannot wait has figures of all of them.
    for round in 0..counted(ROUNDS) {
        for (s, subject) in SUBJECTS.iter().enumerate().filter(|(_, subject)| round < counted(subject.rounds)) {
            for (i, change) in subject.changes.into_iter().enumerate() {
                let scene = Scene::new(subject, Some(change), None);
                let picture = scene.picture(None, 2000 + 100 * i as u64 + round as u64);
                found[s][i] += usize::from(scene.differs(&picture, &references[s]));
            }
        }
        print_figures(&format!("changes of {CHANGES:?} found in {} pictures each: {found:?}", round + 1));
    }
    found
}

/// Alarms of pictures that differ in their seeds alone.
fn equal_alarms(subject: &Subject, references: usize) -> usize {
    let scene = Scene::new(subject, None, subject.equal_spp);
    let spp = subject.equal_spp.unwrap_or_else(|| scene.default_spp());
    let count = subject.equal[1] as u64;
    (0..references as u64)
        .map(|r| {
            let reference = scene.picture(Some(spp * REFERENCE_FACTOR), 1_000_000 + r);
            let seeds = (0..count).map(|i| 100 + r * count + i);
            seeds.filter(|&seed| scene.differs(&scene.picture(Some(spp), seed), &reference)).count()
        })
        .sum()
}

/// A case of a suite.
struct Scene {
    suite: Suite,
    case: Case,
}

impl Scene {
    fn new(subject: &Subject, change: Option<&str>, spp: Option<u32>) -> Self {
        let Subject { name, file, frame, .. } = subject;
        let set = change.map_or_else(String::new, |change| format!(", '{change}'"));
        let spp = spp.map_or_else(String::new, |spp| format!("spp: {spp}, "));
        let text = format!(
            "version: 1\ncases: {{{name}: {{scene: {file}, frame: {frame}, set: ['output.aovs=[]'{set}], {spp}ignore: [A]}}}}"
        );
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("suite.yaml");
        let suite = Suite::from_text(&text, &path).unwrap_or_else(|e| panic!("{e}"));
        let case = suite.cases().next().expect("one case").1;
        Self { suite, case }
    }

    fn default_spp(&self) -> u32 {
        let job = RegressJob::default();
        let making = Making { suite: &self.suite, name: "", case: &self.case, job: &job };
        making.scene(None, 0).unwrap_or_else(|e| panic!("{e}")).0.settings.film.spp
    }

    fn picture(&self, spp: Option<u32>, seed: u64) -> Image {
        let job = RegressJob { memory_limit: 1 << 30, ..RegressJob::default() };
        let making = Making { suite: &self.suite, name: "", case: &self.case, job: &job };
        making.picture(spp, seed, &Silent).unwrap_or_else(|e| panic!("{e}"))
    }

    fn differs(&self, image: &Image, reference: &Image) -> bool {
        let judgement = judge::judge(image, reference, &self.case, &mut Vec::new()).expect("comparable");
        assert!(judgement.is_comparable(), "{}", judgement.summary());
        !judgement.agree()
    }
}
