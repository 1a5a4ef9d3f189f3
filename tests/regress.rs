//! `curlsmoke regress` from the command line.

mod support {
    pub mod program;
}

use support::program::{Folder, contains};

const SUITE: &str = "\
version: 1
defaults: {reference: 'refs/{case}.mean.exr', compare: [stat: {}, exact: {layers: [Z]}, mse: {at_most: 0.01, layers: [albedo]}], ignore: [A, N]}
cases:
  ball: {scene: ball.yaml, spp: 16}
  brighter: {scene: ball.yaml, spp: 16, set: ['lights[0].environment.radiance=[1.1, 1.1, 1.1]'], reference: refs/ball.mean.exr, should_fail: true}
";

const REASON: &str = "first of all: a ball & its <light>";

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("suite.yaml", SUITE);
    folder
}

#[test]
fn references_are_made_for_a_reason_and_pictures_compared_with_them() {
    let folder = folder();
    let [out, _] = folder.expect(7, &["regress", "suite.yaml"]);
    contains(&out, &["FAIL  ball", "no such reference", "--only ball --update --reason"]);
    let [_, error] = folder.expect(2, &["regress", "suite.yaml", "--update"]);
    contains(&error, &["--reason"]);
    folder.expect(2, &["regress", "suite.yaml", "--update", "--reason", "so"]);
    assert!(folder.files("refs").is_empty());
    let [out, _] = folder.expect(0, &["regress", "suite.yaml", "--update", "--reason", REASON]);
    contains(&out, &["ball.mean.exr", "ball.var.exr", "references.md"]);
    let log = std::fs::read_to_string(folder.path("references.md")).unwrap();
    contains(&log, &[REASON, "all 1 of suite.yaml", env!("CARGO_PKG_VERSION")]);
    let reference = curlsmoke::output::read_image(&folder.path("refs/ball.mean.exr"), 1 << 20).unwrap();
    let known = |name: &str| format!("{:?}", reference.attribute(name));
    contains(&known("curlsmoke/reason"), &[REASON]);
    contains(&known("curlsmoke/spp"), &["256"]);
    assert!(reference.channel("albedo.R").is_some() && reference.channel("A").is_none());
    let [out, _] = folder.expect(0, &["regress", "suite.yaml"]);
    contains(&out, &["pass  ball", "pass  brighter"]);
}

#[test]
fn a_pair_that_should_differ_and_does_not_fails_the_suite() {
    let folder = folder();
    folder.expect(0, &["regress", "suite.yaml", "--update", "--reason", REASON]);
    folder.write("suite.yaml", &SUITE.replace("[1.1, 1.1, 1.1]", "[1, 1, 1]"));
    let [out, _] = folder.expect(7, &["regress", "suite.yaml"]);
    contains(&out, &["pass  ball", "FAIL  brighter", "agree, and must not"]);
    let [out, _] = folder.expect(0, &["regress", "suite.yaml", "--only", "ball"]);
    assert!(!out.contains("brighter"));
    let [_, error] = folder.expect(2, &["regress", "suite.yaml", "--only", "bal"]);
    contains(&error, &["did you mean ball?"]);
}

#[test]
fn reports_hold_pictures_and_verdicts_and_ask_the_network_for_nothing() {
    let folder = folder();
    folder.expect(0, &["regress", "suite.yaml", "--update", "--reason", REASON]);
    folder.write("ball.yaml", &support::program::BALL.replace("radius: 1}", "radius: 0.8}"));
    let arguments = ["regress", "suite.yaml", "--report", "out/report", "--junit", "out/junit.xml"];
    folder.expect(7, &arguments);
    assert_eq!(folder.files("out/report"), ["ball.exr", "index.html"]);
    let page = std::fs::read_to_string(folder.path("out/report/index.html")).unwrap();
    contains(&page, &["1 of 2 cases fail", "data:image/png;base64,", "--only ball --update", "beauty", "albedo"]);
    assert!(!page.contains("http") && !page.contains("url(") && !page.contains("<link"));
    assert!(page.find("data-name=\"ball\"") < page.find("data-name=\"brighter\""), "failures come first");
    let xml = std::fs::read_to_string(folder.path("out/junit.xml")).unwrap();
    contains(&xml, &["tests=\"2\" failures=\"1\" errors=\"0\"", "<failure message=\""]);
}

#[test]
fn pictures_of_another_program_are_compared_and_its_commands_asked_for() {
    let folder = Folder::new();
    folder.picture("theirs.exr", 0.5);
    folder.picture("reference.exr", 0.5);
    folder.write(
        "suite.yaml",
        "version: 1\ndefaults: {reference: reference.exr, compare: [exact: {}]}\ncases:\n  found: {image: theirs.exr}\n  \
         made: {command: 'cp theirs.exr {output}'}\n  flipped: {image: theirs.exr, compare: [flip: {at_most: 0}, psnr: \
         {at_least: 90}]}\n",
    );
    let [out, _] = folder.expect(7, &["regress", "suite.yaml"]);
    contains(&out, &["pass  found", "pass  flipped", "FAIL  made", "--run-commands"]);
    folder.expect(0, &["regress", "suite.yaml", "--run-commands"]);
    folder.write(
        "suite.yaml",
        "version: 1\ncases: {made: {command: 'echo gone wrong >&2; exit 3; {output}', reference: reference.exr}}\n",
    );
    let [out, _] = folder.expect(7, &["regress", "suite.yaml", "--run-commands"]);
    contains(&out, &["exit status: 3: gone wrong"]);
}

#[test]
fn references_of_several_runs_know_the_noise_of_every_layer() {
    let folder = Folder::new();
    folder.write(
        "suite.yaml",
        "version: 1\ndefaults: {reference: '{case}.exr', compare: [stat: {pixels: 95}], remake: {runs: 16}}\ncases:\n  ball:\n    \
         command: PROGRAM render ball.yaml --set frames.last=1 --seed {seed} --spp 32 --set output.aovs=[albedo] -o {output}\n",
    );
    let text = std::fs::read_to_string(folder.path("suite.yaml")).unwrap();
    folder.write("suite.yaml", &text.replace("PROGRAM", env!("CARGO_BIN_EXE_curlsmoke")));
    folder.expect(0, &["regress", "suite.yaml", "--run-commands", "--update", "--reason", REASON]);
    let reference = curlsmoke::output::read_image(&folder.path("ball.exr"), 1 << 20).unwrap();
    assert!(["variance.R", "variance.A", "variance.albedo.G"].iter().all(|name| reference.channel(name).is_some()));
    let [out, _] = folder.expect(0, &["regress", "suite.yaml", "--run-commands"]);
    contains(&out, &["beauty, A, albedo agree"]);
}

#[test]
fn faults_of_a_suite_are_named_with_their_places() {
    let folder = Folder::new();
    folder.write("suite.yaml", "version: 1\ncases:\n  a: {scene: ball.yaml, sed: 3}\n  b: {}\n");
    let [_, error] = folder.expect(3, &["regress", "suite.yaml"]);
    contains(&error, &["suite.yaml:3:", "did you mean `seed`?"]);
    folder.expect(4, &["regress", "none.yaml"]);
    let [out, _] = folder.expect(0, &["schema", "--suite"]);
    contains(&out, &["should_fail", "at_most"]);
}
