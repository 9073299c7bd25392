//! Reports: `NAME.csv`, `NAME-*.svg` and one self-contained `study.html`, each written atomically.

use super::chart::{Chart, Mark, Panel, SMALL};
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
    pub figures: Vec<Figure>,
    pub tables: Vec<Table>,
}

pub struct Figure {
    pub file: String,
    pub caption: String,
    pub svg: String,
}

impl Figure {
    /// Plots one metric over time, with a panel per scene and view.
    pub fn of(
        study: &str,
        metric: &str,
        [x_axis, y_axis]: [&str; 2],
        caption: &str,
        rows: &[Row],
        label: &dyn Fn(&Row) -> String,
    ) -> Figure {
        let mut panels: Vec<Panel> = Vec::new();
        for row in rows.iter().filter(|row| row.metric == metric) {
            let title = format!("{}, {}", row.scene, row.view);
            if panels.last().is_none_or(|panel| panel.title != title) {
                panels.push(Panel { title, marks: Vec::new() });
            }
            let mark = Mark {
                label: label(row),
                x: row.ms,
                y: row.error,
                front: row.front,
                auto: row.auto,
            };
            panels.last_mut().expect("pushed above").marks.push(mark);
        }
        let chart = Chart {
            plot: SMALL,
            title: caption.into(),
            x_axis: x_axis.into(),
            y_axis: y_axis.into(),
            columns: 3,
            panels,
        };
        Figure {
            file: format!("{study}-{}.svg", metric.replace('_', "-")),
            caption: caption.into(),
            svg: chart.svg(),
        }
    }
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
        section.figures.iter().try_for_each(|figure| put(&figure.file, &figure.svg))?;
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

const STYLE: &str = "body{font:16px/1.5 Helvetica,Arial,sans-serif;color:#22262b;max-width:1080px;margin:40px auto;padding:0 24px}\
h1{font-size:30px;margin-bottom:4px}h2{font-size:23px;margin-top:44px;border-top:1px solid #e4e7ea;padding-top:28px}h3{font-size:16px;margin-top:32px}\
p{max-width:46em}.soft{color:#6b727a}figure{margin:24px 0}svg{max-width:100%;height:auto}table{border-collapse:collapse;font-size:14px;font-variant-numeric:tabular-nums}\
th,td{padding:3px 14px 3px 0;border-bottom:1px solid #e4e7ea}th{text-align:left;color:#6b727a;font-weight:normal}.scroll th{border-color:#6b727a}\
td.n,th.n{text-align:right}code{background:#f3f4f6;padding:1px 4px;border-radius:3px;overflow-wrap:anywhere}.scroll{overflow-x:auto}";

const READING: &str = "Each mark is one setting: time to the right, error upwards, both logarithmic, so down and left is better. Filled marks are on the front: no other setting is \
both faster and more accurate; a step joins them. Hollow marks are beaten. The ring is the default. Bars are the quartiles of the times; \
where bars overlap, the times are not told apart. All panels of a figure share their axes.";

pub fn html(sections: &[Section], plan: &Plan, origin: &Origin) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>pointillist: accuracy against time</title><style>{STYLE}</style></head><body>\n"
    );
    let _ = writeln!(
        page,
        "<h1>Accuracy against time</h1>\n<p class=\"soft\">pointillist {}</p>",
        env!("CARGO_PKG_VERSION")
    );
    let _ = writeln!(page, "<p>{READING}</p>");
    if origin.is_cpu {
        let _ = writeln!(
            page,
            "<p>These times are of a software device: they compare settings with each other, and say nothing about a GPU.</p>"
        );
    }
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
    let _ = write!(page, "<table>");
    for (what, value) in facts {
        let _ = write!(page, "<tr><th>{what}</th><td><code>{}</code></td></tr>", escaped(&value));
    }
    let _ = writeln!(page, "</table>");
    for section in sections {
        let _ = writeln!(
            page,
            "<h2 id=\"{}\">{}</h2>\n<p>{}</p>",
            section.name,
            escaped(&section.title),
            section.method
        );
        for figure in &section.figures {
            let _ = writeln!(
                page,
                "<figure role=\"img\" aria-label=\"{}\">{}</figure>",
                escaped(&figure.caption),
                inline(&figure.svg)
            );
        }
        section.tables.iter().for_each(|table| write_table(&mut page, table));
        write_table(&mut page, &all_rows(section));
    }
    page + "</body></html>\n"
}

/// Strips the XML prologue, which HTML does not have.
fn inline(svg: &str) -> &str {
    svg.find("<svg").map_or(svg, |at| &svg[at..])
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
    let _ = write!(page, "<h3>{}</h3>\n<div class=\"scroll\"><table><tr>", escaped(&table.title));
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
    let _ = writeln!(page, "</tr></table></div>");
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
