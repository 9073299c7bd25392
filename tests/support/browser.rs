//! Chromium, which opens a page as its readers do.

use crate::program::text;
use crate::skip::skip;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Opens everything in a page, and lists what does not stand where it should.
const LOOK: &str = r#"
document.querySelectorAll("details").forEach((details) => (details.open = true));
const places = [...document.querySelectorAll(".panel > div")];
const look = (tries) => {
  if (tries > 0 && !places.every((place) => place.querySelector("svg"))) {
    setTimeout(() => look(tries - 1), 10);
    return;
  }
  const found = { errors, panels: 0, labels: [], overlaps: [], outside: [], wide: [] };
  for (const place of places) {
    const svg = place.querySelector("svg");
    if (!svg) {
      found.errors.push(`nothing is drawn in ${place.outerHTML}`);
      continue;
    }
    found.panels += 1;
    const name = `chart ${place.dataset.chart} panel ${place.dataset.panel}`;
    const box = (own) => own.getBoundingClientRect();
    const frame = box(svg.querySelector("[aria-label=frame]"));
    const texts = [...svg.querySelectorAll("text")].filter((own) => own.textContent);
    texts.forEach((own, i) => texts.slice(i + 1).forEach((other) => {
      const [a, b] = [box(own), box(other)];
      const apart = a.right <= b.left + 1 || b.right <= a.left + 1 || a.bottom <= b.top + 2 || b.bottom <= a.top + 2;
      if (!apart) found.overlaps.push(`${name}: ${own.textContent} / ${other.textContent}`);
    }));
    for (const own of texts) {
      const [at, all] = [box(own), box(svg)];
      const inside = own.classList.contains("label") ? frame : all;
      if (at.left < inside.left - 1 || at.right > inside.right + 1 || at.top < inside.top - 1 || at.bottom > inside.bottom + 1)
        found.outside.push(`${name}: ${own.textContent}`);
    }
    for (const own of svg.querySelectorAll("[aria-label=dot] circle, [aria-label=rule] line, [aria-label=line] path")) {
      const at = box(own);
      if (!(at.left >= frame.left - 1 && at.right <= frame.right + 1 && at.top >= frame.top - 1 && at.bottom <= frame.bottom + 1))
        found.outside.push(`${name}: ${own.outerHTML}`);
    }
    found.labels.push([...svg.querySelectorAll(".label")].map((own) => own.textContent));
  }
  if (document.documentElement.scrollWidth > innerWidth) found.wide.push(document.documentElement.scrollWidth);
  const said = document.createElement("pre");
  said.id = "found";
  said.textContent = JSON.stringify(found);
  document.body.append(said);
};
look(200);
"#;

/// Returns what a reader finds in a page this wide `[px]`; `None` if there is no Chromium. Nothing
/// can be fetched.
pub fn look(page: &Path, width: u32) -> Option<Value> {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("page.html");
    let own = std::fs::read_to_string(page).unwrap();
    let listening = "<script>const errors = []; addEventListener(\"error\", (event) => errors.push(event.message));</script><title>";
    let own = own.replacen("<title>", listening, 1);
    std::fs::write(&copy, own.replace("</body>", &format!("<script>{LOOK}</script></body>")))
        .unwrap();
    let browser = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--host-resolver-rules=MAP * ~NOTFOUND",
        ])
        .args(["--virtual-time-budget=10000", "--dump-dom"])
        .arg(format!("--window-size={width},900"))
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("file://{}", copy.display()))
        .output();
    let Ok(output) = browser else {
        skip("chromium is missing; Debian has it in chromium");
        return None;
    };
    let page = text(&output.stdout);
    let found =
        page.split_once("<pre id=\"found\">").and_then(|(_, rest)| rest.split_once("</pre>"));
    let (found, _) = found.unwrap_or_else(|| panic!("chromium: {}", text(&output.stderr)));
    let found = found.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    Some(serde_json::from_str(&found).unwrap())
}
