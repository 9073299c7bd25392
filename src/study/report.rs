//! Reports: `NAME.csv` and one self-contained `study.html`, each written atomically.
//!
//! The page draws its charts itself, with Observable Plot and D3, which it contains: `page/` has
//! them as their makers publish them, with their licences.

use super::chart::{Chart, Mark, Panel};
use super::{Plan, Row};
use crate::atomic_file::write_atomically;
use crate::error::{Error, Result};
use crate::graph::Gpu;
use std::fmt::Write as _;
use std::path::Path;

/// The results of a study.
pub struct Section {
    pub name: &'static str,
    pub title: String,
    /// Method and interpretation, HTML.
    pub method: String,
    pub rows: Vec<Row>,
    /// The first one is shown, the others on request.
    pub charts: Vec<Chart>,
    pub tables: Vec<Table>,
}

/// Returns the chart of one metric over time, with a panel per scene and view.
pub fn chart(
    metric: &str,
    axes: [&str; 2],
    title: &str,
    rows: &[Row],
    label: &dyn Fn(&Row) -> String,
) -> Chart {
    let mut panels: Vec<Panel> = Vec::new();
    for row in rows.iter().filter(|row| row.metric == metric) {
        let title = format!("{}, {}", row.scene, row.view);
        if panels.last().is_none_or(|panel| panel.title != title) {
            panels.push(Panel { title, marks: Vec::new() });
        }
        let mark = Mark::new(label(row), row.ms, row.error, row.auto);
        panels.last_mut().expect("pushed above").marks.push(mark);
    }
    Chart::new(title, axes, "ms", panels)
}

pub struct Table {
    pub title: String,
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// Origin of the numbers: machine, version, options.
pub struct Origin {
    pub device: String,
    pub driver: String,
    pub is_cpu: bool,
    pub commit: Option<String>,
    pub command: String,
}

impl Origin {
    pub fn here(gpu: &Gpu) -> Origin {
        let git = std::process::Command::new("git")
            .args(["describe", "--always", "--dirty", "--abbrev=12"])
            .output();
        let commit = git
            .ok()
            .filter(|out| out.status.success())
            .and_then(|out| String::from_utf8(out.stdout).ok())
            .map(|text| text.trim().to_string());
        let command = std::env::args().collect::<Vec<_>>().join(" ");
        Origin {
            device: gpu.device.name.clone(),
            driver: gpu.device.driver.clone(),
            is_cpu: gpu.device.is_cpu,
            commit,
            command,
        }
    }
}

pub const COLUMNS: &str =
    "study,scene,view,parameter,value,metric,error,ms_median,ms_q1,ms_q3,n,auto,front,device";

pub fn write(folder: &Path, sections: &[Section], plan: &Plan, origin: &Origin) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
    let put = |name: &str, text: &str| {
        let path = folder.join(name);
        write_atomically(&path, |partial| {
            std::fs::write(partial, text).map_err(|error| Error::io("write", &path, error))
        })
    };
    for section in sections {
        put(&format!("{}.csv", section.name), &csv(section, origin))?;
    }
    put("study.html", &html(sections, plan, origin))
}

/// Formats RFC 4180 CSV: fields with a comma or a quote are quoted. Numbers are the shortest that
/// read back unchanged.
pub fn csv(section: &Section, origin: &Origin) -> String {
    let field = |text: &str| {
        if text.contains([',', '"', '\n']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text.to_string()
        }
    };
    let mut text = format!("{COLUMNS}\n");
    for row in &section.rows {
        let Row {
            scene,
            view,
            parameter,
            value,
            metric,
            error,
            ms: [q1, median, q3],
            n,
            auto,
            front,
        } = row;
        let (name, device) = (section.name, field(&origin.device));
        let _ = writeln!(
            text,
            "{name},{scene},{view},{parameter},{},{metric},{error:e},{median},{q1},{q3},{n},{auto},{front},{device}",
            field(value)
        );
    }
    text
}

const STYLE: &str = include_str!("page/page.css");
/// D3 7.9.0 and Observable Plot 0.6.17.
const LIBRARIES: [&str; 2] = [include_str!("page/d3.min.js"), include_str!("page/plot.min.js")];
const LICENSES: [&str; 2] = [include_str!("page/LICENSE-d3"), include_str!("page/LICENSE-plot")];
const SCRIPT: &str = include_str!("page/page.js");

const READING: &str = "Each mark is one setting. What it costs lies to the right, its error upwards, both logarithmic: down and left is better. \
Errors of exactly 0, and what costs nothing (none), have a place of their own beside the scale. A step joins the front. Bars are quartiles of the costs; where they overlap, costs are not told apart. \
Point at a mark for its name and numbers.";

const LEGEND: &str = r#"<p class="legend"><span><svg width="20" height="20"><circle cx="10" cy="10" r="4" fill="var(--front)"/></svg> on the front: nothing is both cheaper and more accurate</span> <span><svg width="20" height="20"><circle cx="10" cy="10" r="4" fill="none" stroke="var(--soft)" stroke-width="1.5"/></svg> beaten</span> <span><svg width="20" height="20"><circle cx="10" cy="10" r="8" fill="none" stroke="var(--auto)" stroke-width="2"/></svg> what is done automatically</span></p>"#;

/// Returns the page: a section per study with one chart and its conclusion; the rest opens on
/// request.
pub fn html(sections: &[Section], plan: &Plan, origin: &Origin) -> String {
    let commit = origin.commit.as_deref().unwrap_or("unknown (no git here)");
    let facts = [
        ("device", origin.device.clone()),
        ("driver", origin.driver.clone()),
        ("commit", commit.to_string()),
        ("seed", plan.seed.to_string()),
        ("points a scene", plan.points.to_string()),
        ("rounds", plan.repeat.to_string()),
        ("picture", format!("{} x {}", plan.size[0], plan.size[1])),
        ("command", origin.command.clone()),
    ];
    let mut body = format!(
        "<h1>Accuracy against time</h1>\n<p class=\"soft\">pointillist {} on {}</p>\n<p>{READING}</p>\n{LEGEND}\n",
        env!("CARGO_PKG_VERSION"),
        escaped(&origin.device)
    );
    if origin.is_cpu {
        body += "<p>These times are of a software device: they compare settings with each other, and say nothing about a GPU.</p>\n";
    }
    body += "<details><summary>Where these numbers are from</summary><table>";
    for (what, value) in facts {
        let _ = write!(body, "<tr><th>{what}</th><td><code>{}</code></td></tr>", escaped(&value));
    }
    body += "</table></details>\n<nav>";
    for Section { name, title, .. } in sections {
        let _ = write!(body, "<a href=\"#{name}\">{}</a>", escaped(title));
    }
    body += "</nav>\n";
    let mut charts = Vec::new();
    let from = format!("{}, commit {commit}", origin.device);
    sections.iter().for_each(|section| write_section(&mut body, section, &mut charts, &from));
    page("pointillist: accuracy against time", &body, &charts)
}

/// Returns a page of one chart.
pub fn chart_page(chart: &Chart, table: &Table) -> String {
    let mut body = format!("<h1>{}</h1>\n<p>{READING}</p>\n{LEGEND}\n", escaped(&chart.title));
    let mut charts = Vec::new();
    write_chart(&mut body, chart, &mut charts);
    write_table(&mut body, table);
    page(&chart.title, &body, &charts)
}

fn page(title: &str, body: &str, charts: &[&Chart]) -> String {
    // Nothing within ends the element.
    let data = serde_json::to_string(charts).expect("numbers and texts").replace("</", "<\\/");
    let [d3, plot] = LIBRARIES;
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{}</title>\n<style>\n{STYLE}</style></head><body>\n{body}\
         <script id=\"charts\" type=\"application/json\">{data}</script>\n\
         <!-- D3\n{}\nObservable Plot\n{} -->\n\
         <script>{d3}</script>\n<script>{plot}</script>\n<script>\n{SCRIPT}</script>\n</body></html>\n",
        escaped(title),
        LICENSES[0],
        LICENSES[1]
    )
}

fn write_section<'c>(
    page: &mut String,
    section: &'c Section,
    charts: &mut Vec<&'c Chart>,
    from: &str,
) {
    let _ = writeln!(page, "<section id=\"{}\"><h2>{}</h2>", section.name, escaped(&section.title));
    let (first, others) = section.charts.split_at(section.charts.len().min(1));
    first.iter().for_each(|chart| write_chart(page, chart, charts));
    if !others.is_empty() {
        let _ = writeln!(page, "<details><summary>{} other measures</summary>", others.len());
        others.iter().for_each(|chart| write_chart(page, chart, charts));
        let _ = writeln!(page, "</details>");
    }
    section.tables.iter().for_each(|table| write_table(page, table));
    write_table(page, &all_rows(section));
    let _ = writeln!(
        page,
        "<details><summary>How this was measured</summary><p>{}</p></details>\n<p class=\"soft\">{}</p></section>",
        section.method,
        escaped(from)
    );
}

/// Writes the places that the page's script draws a chart in.
fn write_chart<'c>(page: &mut String, chart: &'c Chart, charts: &mut Vec<&'c Chart>) {
    let own = charts.len();
    charts.push(chart);
    let _ = writeln!(
        page,
        "<figure><figcaption><b>{}</b><br>{}</figcaption><div class=\"panel\"><h4>{}</h4><div data-chart=\"{own}\"></div></div></figure>",
        escaped(&chart.title),
        escaped(&chart.conclusion),
        escaped(&chart.pooled.title)
    );
    if chart.apart.is_empty() {
        return;
    }
    let _ =
        writeln!(page, "<details><summary>Scenes and views apart</summary><div class=\"panels\">");
    for (number, panel) in chart.apart.iter().enumerate() {
        let _ = writeln!(
            page,
            "<div class=\"panel\"><h4>{}</h4><div data-chart=\"{own}\" data-panel=\"{number}\"></div></div>",
            escaped(&panel.title)
        );
    }
    let _ = writeln!(page, "</div></details>");
}

fn all_rows(section: &Section) -> Table {
    let row = |row: &Row| {
        let [q1, median, q3] = row.ms;
        let mark = |is: bool| if is { "yes" } else { "" }.to_string();
        let error = if row.error == 0.0 { "0".to_string() } else { format!("{:.2e}", row.error) };
        let ms = format!("{median:.2} ({q1:.2} to {q3:.2})");
        vec![
            row.scene.into(),
            row.view.into(),
            row.metric.into(),
            format!("{} {}", row.value, row.parameter),
            error,
            ms,
            row.n.to_string(),
            mark(row.front),
        ]
    };
    let head = ["scene", "view", "metric", "setting", "error", "ms (quartiles)", "n", "front"]
        .map(String::from)
        .to_vec();
    Table { title: "All configurations".into(), head, rows: section.rows.iter().map(row).collect() }
}

fn write_table(page: &mut String, table: &Table) {
    let _ = write!(
        page,
        "<details><summary>Table: {}</summary><div class=\"scroll\"><table><tr>",
        escaped(&table.title)
    );
    // Columns of numbers are aligned right.
    let numeric = |column: usize| {
        table.rows.iter().all(|row| row[column].starts_with(|c: char| c.is_ascii_digit()))
    };
    let class: Vec<&str> = (0..table.head.len())
        .map(|column| if numeric(column) { " class=\"n\"" } else { "" })
        .collect();
    for (name, class) in table.head.iter().zip(&class) {
        let _ = write!(page, "<th{class}>{}</th>", escaped(name));
    }
    for row in &table.rows {
        let _ = write!(page, "</tr>\n<tr>");
        for (cell, class) in row.iter().zip(&class) {
            let _ = write!(page, "<td{class}>{}</td>", escaped(cell));
        }
    }
    let _ = writeln!(page, "</tr></table></div></details>");
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
