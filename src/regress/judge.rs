//! From what a case says to checks of layers, and their verdicts.

use crate::output::agreement::StatisticalSettings;
use crate::output::compare::{CompareError, Finding, Measure, Mode, Report, compare_layer, reference_noise};
use crate::output::flip::FlipSettings;
use crate::output::image::Image;
use crate::output::layers::{Layer, layers_of};
use crate::scene::suite::{Case, Check, StatCheck};

/// What was found in all layers.
#[derive(Debug)]
pub struct Judgement {
    /// What is wrong with the pictures as wholes: windows, layers that are missing or new.
    pub structure: Vec<Finding>,
    /// The verdicts on layers, in the order of the layers, beauty first.
    pub layers: Vec<LayerJudgement>,
}

/// One check of one layer.
#[derive(Debug)]
pub struct LayerJudgement {
    /// The layer.
    pub layer: Layer,
    /// Name of the check.
    pub check: &'static str,
    /// What it found.
    pub report: Report,
}

impl Judgement {
    /// Whether the pictures have the same windows and layers, each with a check.
    pub fn is_comparable(&self) -> bool {
        self.structure.iter().all(|finding| finding.passed)
    }

    /// Whether nothing was found.
    pub fn agree(&self) -> bool {
        self.is_comparable() && self.layers.iter().all(|layer| layer.report.passed())
    }

    /// In a line the first thing that is wrong, or that nothing is.
    pub fn summary(&self) -> String {
        let structure = self.structure.iter().find(|f| !f.passed).map(|f| f.text.clone());
        let layer = self.layers.iter().find_map(|layer| {
            let finding = layer.report.findings.iter().find(|f| !f.passed)?;
            Some(format!("{}: {}: {}", layer.layer.name, finding.check, finding.text))
        });
        structure.or(layer).unwrap_or_else(|| {
            let mut names: Vec<&str> = self.layers.iter().map(|layer| layer.layer.name.as_str()).collect();
            names.dedup();
            format!("{} agree", names.join(", "))
        })
    }
}

/// How a check compares.
fn mode_of(check: &Check) -> Mode {
    match check {
        Check::Exact(_) => Mode::Exact,
        Check::Stat(check) => {
            Mode::Statistical(StatisticalSettings { alpha: check.alpha, pixel_share: check.pixels / 100.0 })
        }
        Check::Mse(check) => Mode::Measure(Measure::Mse, check.at_most),
        Check::Relmse(check) => Mode::Measure(Measure::RelMse, check.at_most),
        Check::Max(check) => Mode::Measure(Measure::Max, check.at_most),
        Check::Psnr(check) => Mode::Measure(Measure::Psnr, check.at_least),
        Check::Flip(check) => {
            Mode::Flip(FlipSettings { pixels_per_degree: check.pixels_per_degree, ldr: check.ldr }, check.at_most)
        }
    }
}

/// Compares a picture with its reference as a case says.
///
/// # Errors
/// When a check needs what the pictures do not have.
pub fn judge(
    image: &Image,
    reference: &Image,
    case: &Case,
    warnings: &mut Vec<String>,
) -> Result<Judgement, CompareError> {
    let mut judgement = Judgement { structure: Vec::new(), layers: Vec::new() };
    let wrong = |text: String| Finding { check: "layers", passed: false, text };
    let window = |i: &Image| (i.size, i.data_origin, i.data_size);
    if window(image) != window(reference) {
        let text = |i: &Image| {
            let ([w, h], [x, y], [dw, dh]) = (i.size, i.data_origin, i.data_size);
            format!("{w} × {h} pixels (of which {dw} × {dh} from {x}, {y})")
        };
        judgement.structure.push(Finding {
            check: "size",
            passed: false,
            text: format!("{} against {}", text(image), text(reference)),
        });
        return Ok(judgement);
    }
    let is_ignored = |name: &str| case.ignore.iter().flatten().any(|ignored| ignored == name);
    let known = |image: &Image| -> Vec<Layer> {
        layers_of(image).into_iter().filter(|layer| !is_ignored(&layer.name)).collect()
    };
    let (ours, theirs) = (known(image), known(reference));
    let default = [Check::Stat(StatCheck::default())];
    let checks = case.compare.as_deref().unwrap_or(&default);
    for layer in theirs.iter().filter(|layer| !ours.iter().any(|own| own.name == layer.name)) {
        judgement.structure.push(wrong(format!("the picture has no layer `{}`, the reference has", layer.name)));
    }
    for name in checks.iter().flat_map(Check::layers) {
        if !ours.iter().chain(&theirs).any(|layer| layer.name == *name) {
            judgement.structure.push(wrong(format!("a check is for the layer `{name}`, which neither picture has")));
        }
    }
    for layer in &ours {
        let Some(other) = theirs.iter().find(|other| other.name == layer.name) else {
            judgement.structure.push(wrong(format!(
                "the picture has a layer `{}`, the reference has not; remake it, or name the layer in `ignore`",
                layer.name
            )));
            continue;
        };
        if other.parts != layer.parts {
            let text = format!("{} against {}", layer.channel_names().join(" "), other.channel_names().join(" "));
            judgement.structure.push(wrong(text));
            continue;
        }
        let mut own: Vec<&Check> = checks.iter().filter(|check| check.layers().contains(&layer.name)).collect();
        if own.is_empty() {
            own = checks.iter().filter(|check| check.layers().is_empty()).collect();
        }
        if own.is_empty() {
            let text = format!("no check is for the layer `{}`; add one, or name it in `ignore`", layer.name);
            judgement.structure.push(wrong(text));
        }
        for check in own {
            let mode = mode_of(check);
            warnings.extend(reference_noise(image, reference, layer, mode));
            let report = match compare_layer(image, reference, layer, mode) {
                Err(CompareError::NoVariance) => {
                    judgement.structure.push(wrong(format!(
                        "nothing says how noisy the layer `{}` is; give it another check than `stat`, or make its reference of \
                         several runs (`remake`)",
                        layer.name
                    )));
                    continue;
                }
                report => report?,
            };
            judgement.layers.push(LayerJudgement { layer: layer.clone(), check: check.name(), report });
        }
    }
    if judgement.layers.is_empty() && judgement.structure.is_empty() {
        judgement.structure.push(wrong("there is no layer to compare".into()));
    }
    Ok(judgement)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::image::SampleKind;
    use crate::scene::suite::Suite;
    use std::path::Path;

    fn picture(names: &[&str], value: f32) -> Image {
        let mut image = Image::new([4, 4]);
        names.iter().for_each(|name| image.push(*name, SampleKind::Float, vec![value; 16]));
        image
    }

    fn judged(compare: &str, image: &Image, reference: &Image) -> Judgement {
        let text = format!("version: 1\ncases: {{a: {{image: a.exr, {compare}}}}}");
        let suite = Suite::from_text(&text, Path::new("s.yaml")).unwrap_or_else(|e| panic!("{e}"));
        let case = suite.cases().next().unwrap().1;
        judge(image, reference, &case, &mut Vec::new()).unwrap()
    }

    const BEAUTY: [&str; 3] = ["R", "G", "B"];

    #[test]
    fn each_layer_has_its_own_threshold_and_the_rest_the_common_one() {
        let names = ["R", "G", "B", "Z", "A"];
        let (image, reference) = (picture(&names, 1.0), picture(&names, 1.05));
        let compare = "compare: [max: {at_most: 0.1}, exact: {layers: [Z]}, mse: {at_most: 1e-4, layers: [A]}]";
        let verdicts: Vec<(String, &str, bool)> = judged(compare, &image, &reference)
            .layers
            .into_iter()
            .map(|layer| (layer.layer.name.clone(), layer.check, layer.report.passed()))
            .collect();
        let expected = [("beauty", "max", true), ("A", "mse", false), ("Z", "exact", false)];
        assert_eq!(verdicts, expected.map(|(layer, check, passed)| (layer.to_string(), check, passed)));
    }

    #[test]
    fn layers_without_their_like_and_without_a_check_are_findings() {
        let more = picture(&["R", "G", "B", "N.X"], 1.0);
        let exact = "compare: [exact: {}]";
        for (image, reference) in [(&more, &picture(&BEAUTY, 1.0)), (&picture(&BEAUTY, 1.0), &more)] {
            let judgement = judged(exact, image, reference);
            assert!(!judgement.agree() && judgement.summary().contains("`N`"), "{}", judgement.summary());
            assert!(judged("compare: [exact: {}], ignore: [N]", image, reference).agree());
        }
        assert!(!judged("compare: [exact: {layers: [beauty]}]", &more, &more).agree());
        assert!(judged("compare: [stat: {}]", &more, &more).summary().contains("how noisy the layer `beauty` is"));
        assert!(!judged("compare: [exact: {}, max: {at_most: 1, layers: [Q]}]", &more, &more).agree());
        let mut small = picture(&BEAUTY, 1.0);
        small.size = [8, 8];
        assert!(!judged(exact, &small, &picture(&BEAUTY, 1.0)).is_comparable());
    }

    #[test]
    fn no_number_is_forgiven_where_both_have_none() {
        let with = |value: f32| {
            let mut image = picture(&BEAUTY, 1.0);
            image.channels[1].data[3] = value;
            image
        };
        for check in ["exact: {}", "max: {at_most: 0.5}", "flip: {at_most: 0.1}"] {
            let compare = format!("compare: [{check}]");
            for value in [f32::NAN, f32::INFINITY] {
                assert!(judged(&compare, &with(value), &with(value)).agree(), "{check} {value}");
                assert!(!judged(&compare, &with(value), &with(1.0)).agree(), "{check} {value}");
                assert!(!judged(&compare, &with(1.0), &with(value)).agree(), "{check} {value}");
            }
        }
    }
}
