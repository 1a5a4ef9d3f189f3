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

/// Scenes, and their changes by a per cent: of density, albedo and light.
const SCENES: [(&str, [&str; 3]); 3] = [
    (
        "wisp",
        [
            "smoke.medium.extinction=10.1",
            "smoke.medium.albedo=[0.505, 0.505, 0.505]",
            "lights[0].environment.radiance=[1.01, 1.01, 1.01]",
        ],
    ),
    (
        "haze",
        [
            "volumes.haze.medium.extinction=1.01",
            "volumes.haze.medium.albedo=[0.808, 0.808, 0.808]",
            "lights[0].sun.irradiance=[3.03, 3.03, 3.03]",
        ],
    ),
    (
        "lamp",
        [
            "volumes.mist.medium.extinction=0.808",
            "volumes.mist.medium.albedo=[0.808, 0.808, 0.808]",
            "lights[0].point.intensity=[1.01, 1.01, 1.01]",
        ],
    ),
];

const CHANGES: [&str; 3] = ["density", "albedo", "light"];

/// Comparisons of equal light, in all scenes together; each reference is for a few of them, since its own error is in all of those.
const EQUAL_COUNT: usize = 1050;
const PICTURES_A_REFERENCE: usize = 25;
/// Paths a pixel of these: fewer than by default, since the rate is what counts and tails are heavier with few.
const EQUAL_SPP: u32 = 64;
/// Comparisons for each change of each scene.
const CHANGED_COUNT: usize = 20;
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
    let references = counted(EQUAL_COUNT / SCENES.len() / PICTURES_A_REFERENCE);
    let equal = references * PICTURES_A_REFERENCE;
    let alarms = SCENES.map(|(name, _)| {
        let alarms = equal_alarms(name, references);
        print_figures(&format!("{name}: {alarms} alarms in {equal} comparisons of equal light"));
        alarms
    });
    let found = changes_found(counted(CHANGED_COUNT));
    let changed = counted(CHANGED_COUNT);
    let mut text = String::from(
        "| scene | equal light: alarms | density +1 % | albedo +1 % | light +1 % |\n|---|---|---|---|---|\n",
    );
    for (s, (name, _)) in SCENES.into_iter().enumerate() {
        let _ = write!(text, "| {name} | {} of {equal} |", alarms[s]);
        found[s].iter().for_each(|found| {
            let _ = write!(text, " {found} of {changed} |");
        });
        text += "\n";
    }
    let percent = |part: usize, whole: usize| 100.0 * part as f64 / (whole * SCENES.len()) as f64;
    let all: usize = alarms.iter().sum();
    let _ = write!(text, "| all | {all} of {}: {:.1} % |", equal * SCENES.len(), percent(all, equal));
    for i in 0..CHANGES.len() {
        let _ = write!(text, " {:.1} % |", percent(found.iter().map(|found| found[i]).sum(), changed));
    }
    let _ = writeln!(
        text,
        "\n\nEqual light with {EQUAL_SPP} paths a pixel, changes with {:.0} million in the picture, references with \
         {REFERENCE_FACTOR} times as many; 48 × 27 pixels, `stat` with its defaults.",
        PATHS_DEFAULT as f64 / 1e6
    );
    text
}

/// How often each change of each scene is found in so many pictures.
fn changes_found(count: usize) -> [[usize; CHANGES.len()]; SCENES.len()] {
    let same = SCENES.map(|(name, _)| Scene::new(name, None, None));
    let references = same.map(|scene| scene.picture(Some(scene.default_spp() * REFERENCE_FACTOR), 1));
    let mut found = [[0; CHANGES.len()]; SCENES.len()];
    // Round after round, so that whoever cannot wait has figures of all of them.
    for round in 0..count as u64 {
        for (s, (name, changes)) in SCENES.into_iter().enumerate() {
            for (i, change) in changes.into_iter().enumerate() {
                let scene = Scene::new(name, Some(change), None);
                let picture = scene.picture(None, 2000 + 100 * i as u64 + round);
                found[s][i] += usize::from(scene.differs(&picture, &references[s]));
            }
        }
        print_figures(&format!("changes of {CHANGES:?} found in {} pictures each: {found:?}", round + 1));
    }
    found
}

/// Alarms of pictures that differ in their seeds alone.
fn equal_alarms(name: &str, references: usize) -> usize {
    let scene = Scene::new(name, None, Some(EQUAL_SPP));
    (0..references as u64)
        .map(|r| {
            let reference = scene.picture(Some(EQUAL_SPP * REFERENCE_FACTOR), 1_000_000 + r);
            let seeds = (0..PICTURES_A_REFERENCE as u64).map(|i| 100 + r * PICTURES_A_REFERENCE as u64 + i);
            seeds.filter(|&seed| scene.differs(&scene.picture(Some(EQUAL_SPP), seed), &reference)).count()
        })
        .sum()
}

/// A case of a suite.
struct Scene {
    suite: Suite,
    case: Case,
}

impl Scene {
    fn new(name: &str, change: Option<&str>, spp: Option<u32>) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/alarm_rate");
        let set = change.map_or_else(String::new, |change| format!("set: ['{change}'], "));
        let spp = spp.map_or_else(String::new, |spp| format!("spp: {spp}, "));
        let text = format!("version: 1\ncases: {{{name}: {{scene: {name}.yaml, {set}{spp}ignore: [A]}}}}");
        let suite = Suite::from_text(&text, &folder.join("suite.yaml")).unwrap_or_else(|e| panic!("{e}"));
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
