//! The parts of docs/performance.md that are written by a command.

use std::error::Error;
use std::path::Path;

/// Replaces what stands between the marks of `name`.
///
/// # Errors
/// A page without the marks, or that cannot be written.
pub fn write(name: &str, command: &str, text: &str) -> Result<(), Box<dyn Error>> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/performance.md");
    let old = std::fs::read_to_string(&page)?;
    let (begin, end) = (format!("<!-- {name}: begin, written by {command} -->"), format!("<!-- {name}: end -->"));
    let between = old.split_once(&begin).and_then(|(before, rest)| Some((before, rest.split_once(&end)?.1)));
    let (before, after) =
        between.ok_or_else(|| format!("{}: no place for it between `{begin}` and `{end}`", page.display()))?;
    let new = format!("{before}{begin}\n\n{}\n\n{end}{after}", text.trim());
    curlsmoke::output::file::write_atomic(&page, new.as_bytes())?;
    println!("written into {}", page.display());
    Ok(())
}
