//! When a bench calls a kernel slower, and what it refuses to compare with.

#[path = "../benches/kernels/record.rs"]
#[allow(dead_code, reason = "each of the two that compile it uses another part")]
mod record;

use curlsmoke::math::hash::{CounterRng, Seed};
use curlsmoke::math::statistics::normal_quantile;
use record::{DRIFT, Figure, LEVEL, Record, figure, threshold};
use std::path::Path;

/// A kernel of 100 cycles, times `factor`, measured by `processes` that differ by `spread`.
fn measured(rng: &mut CounterRng, processes: usize, spread: f64, factor: f64) -> Figure {
    let mut error = || spread * normal_quantile(f64::from(rng.uniform()).clamp(1e-7, 1.0 - 1e-7));
    let costs: Vec<[f64; 2]> = (0..processes).map(|_| factor * 100.0 * error().exp()).map(|c| [0.25 * c, c]).collect();
    figure("point", &costs, None)
}

/// With spreads so large that the test decides, and not the least ratio that counts, it is wrong as rarely as it says.
#[test]
fn kernels_that_did_not_change_are_rarely_called_slower() {
    const SPREAD: f64 = 0.2;
    const TRIALS: usize = 20_000;
    let mut rng = CounterRng::new(Seed(1));
    let wrong = (0..TRIALS)
        .filter(|_| {
            let (then, now) = (measured(&mut rng, 8, SPREAD, 1.0), measured(&mut rng, 4, SPREAD, 1.0));
            now.cycles / then.cycles > threshold(&then, &now, 1)
        })
        .count() as f64;
    let expected = LEVEL * TRIALS as f64;
    assert!((wrong - expected).abs() < 5.0 * expected.sqrt(), "{wrong} of {TRIALS}, expected {expected}");
}

#[test]
fn kernels_that_slowed_down_are_found() {
    let mut rng = CounterRng::new(Seed(2));
    for _ in 0..1000 {
        let (then, now) = (measured(&mut rng, 8, 0.01, 1.0), measured(&mut rng, 4, 0.01, 1.2));
        let limit = threshold(&then, &now, 21);
        assert!(limit >= DRIFT && now.cycles / then.cycles > limit, "{limit} {now:?}");
    }
    // More kernels make each of them less suspicious, and noise makes all of them so.
    let [quiet, noisy] = [0.05, 0.2].map(|spread| measured(&mut rng, 8, spread, 1.0));
    assert!(threshold(&noisy, &noisy, 21) > threshold(&noisy, &noisy, 1));
    assert!(threshold(&noisy, &noisy, 1) > threshold(&quiet, &quiet, 1));
}

#[test]
fn one_process_says_nothing_of_spread() {
    let lone = measured(&mut CounterRng::new(Seed(3)), 1, 0.1, 1.0);
    assert_eq!(lone.spread, 0.0);
    assert_eq!(threshold(&lone, &lone, 21), f64::INFINITY);
}

#[test]
fn a_figure_is_the_middle_of_its_processes() {
    let of_three = figure("ray", &[[30.0, 400.0], [10.0, 100.0], [20.0, 200.0]], Some(7.0));
    assert!((of_three.nanoseconds - 20.0).abs() < 1e-12 && (of_three.cycles - 200.0).abs() < 1e-9);
    assert!((of_three.spread - 2f64.ln()).abs() < 1e-6);
    assert_eq!((of_three.processes, of_three.instructions), (3, Some(7.0)));
}

#[test]
fn the_recorded_file_reads_back_as_written() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/recorded.json");
    let text = std::fs::read_to_string(path).unwrap();
    let record = Record::parse(&text).unwrap();
    assert!(!record.kernels.is_empty() && !record.processor.is_empty());
    assert_eq!(record.to_text(), text);
}

#[test]
fn figures_that_cannot_be_are_refused_by_name() {
    let mut good = Record { processor: "one".into(), ..Default::default() };
    good.kernels.insert("walk".into(), figure("cell", &[[1.0, 4.0], [1.0, 4.0]], None));
    assert_eq!(Record::parse(&good.to_text()).unwrap(), good);
    let spoil: [fn(&mut Figure); 5] = [
        |f| f.cycles = 0.0,
        |f| f.nanoseconds = -1.0,
        |f| f.spread = -0.1,
        |f| f.processes = 0,
        |f| f.instructions = Some(0.0),
    ];
    for change in spoil {
        let mut bad = good.clone();
        change(bad.kernels.get_mut("walk").unwrap());
        assert!(Record::parse(&bad.to_text()).unwrap_err().contains("`walk`"));
    }
    assert!(Record::parse(&good.to_text().replace("\"unit\"", "\"units\"")).unwrap_err().contains("line"));
    assert!(Record::parse("").is_err());
}
