//! JUnit XML, which test servers read.

use crate::regress::CaseResult;
use std::fmt::Write as _;

/// A report of a suite with this name.
#[derive(Debug)]
pub struct JunitReport {
    suite: String,
    cases: String,
    count: usize,
    failures: usize,
    errors: usize,
    seconds: f64,
}

impl JunitReport {
    /// A report without cases.
    pub fn new(suite: &str) -> Self {
        Self { suite: escaped(suite), cases: String::new(), count: 0, failures: 0, errors: 0, seconds: 0.0 }
    }

    /// Takes in a case: a failure where pictures differ, an error where there was nothing to compare.
    pub fn add(&mut self, result: &CaseResult) {
        self.count += 1;
        self.seconds += result.seconds;
        let (name, text) = (escaped(&result.name), escaped(&result.summary()));
        // Writing to a String cannot fail.
        let _ = writeln!(
            self.cases,
            "    <testcase classname=\"{}\" name=\"{name}\" time=\"{:.3}\">",
            self.suite, result.seconds
        );
        let tag = match &result.outcome {
            Err(_) => {
                self.errors += 1;
                Some("error")
            }
            Ok(_) if !result.passed() => {
                self.failures += 1;
                Some("failure")
            }
            Ok(_) => None,
        };
        let figures = escaped(&figures(result));
        let _ = match tag {
            Some(tag) => {
                let how = escaped(&result.update_command);
                writeln!(self.cases, "      <{tag} message=\"{text}\">{figures}to accept it: {how}</{tag}>")
            }
            None => writeln!(self.cases, "      <system-out>{figures}</system-out>"),
        };
        self.cases += "    </testcase>\n";
    }

    /// The file.
    pub fn finish(&self) -> String {
        let counts = format!(
            "tests=\"{}\" failures=\"{}\" errors=\"{}\" time=\"{:.3}\"",
            self.count, self.failures, self.errors, self.seconds
        );
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites {counts}>\n  <testsuite name=\"{}\" {counts}>\n{}  \
             </testsuite>\n</testsuites>\n",
            self.suite, self.cases
        )
    }
}

/// A line for each finding and each warning.
fn figures(result: &CaseResult) -> String {
    let mut text = String::new();
    let line =
        |passed: bool, what: &str, found: &str| format!("{}  {what}: {found}\n", if passed { "pass" } else { "FAIL" });
    if let Ok(compared) = &result.outcome {
        for finding in &compared.judgement.structure {
            text += &line(finding.passed, finding.check, &finding.text);
        }
        for layer in &compared.judgement.layers {
            for finding in &layer.report.findings {
                text += &line(finding.passed, &format!("{}: {}", layer.layer.name, finding.check), &finding.text);
            }
        }
    }
    for warning in &result.warnings {
        text += &format!("warning: {warning}\n");
    }
    text
}

/// Text as it may stand in XML, and in HTML: what has a meaning there is spelt out, and what may not stand there is left out.
pub fn escaped(text: &str) -> String {
    let mut result = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => result += "&amp;",
            '<' => result += "&lt;",
            '>' => result += "&gt;",
            '"' => result += "&quot;",
            '\'' => result += "&#39;",
            '\n' | '\t' => result.push(c),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => result.push(c),
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_breaks_the_file() {
        let mut report = JunitReport::new("a<b>&\"c\"\u{1b}.yaml");
        report.add(&CaseResult {
            name: "x".into(),
            should_fail: false,
            outcome: Err("]]> <no> & \u{0}\u{8} 'quotes' \"here\"".into()),
            warnings: Vec::new(),
            seconds: 1.5,
            update_command: "x --reason \"why\"".into(),
        });
        let text = report.finish();
        assert!(
            text.contains("name=\"a&lt;b&gt;&amp;&quot;c&quot;.yaml\" tests=\"1\" failures=\"0\" errors=\"1\""),
            "{text}"
        );
        assert!(text.contains("message=\"]]&gt; &lt;no&gt; &amp;  &#39;quotes&#39; &quot;here&quot;\""), "{text}");
        assert_eq!(text.matches("<testcase").count(), text.matches("</testcase>").count());
    }
}
