//! `erfgs doctor`: what this machine has, what it lacks, and what to install.

use std::{process::Command, time::Duration};

use anyhow::bail;
use erfgs_base::children::answer;
use erfgs_points::{Colmap, ColmapProgram};
use erfgs_splat::gpu::{AdapterChoice, Gpu, GpuError, Shape, adapters, run_canary};
use serde::Serialize;

use crate::terminal::{Terminal, bytes, table};

/// Check this machine.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs doctor
  erfgs doctor --adapter llvmpipe
  erfgs doctor --json | jq .adapter.canary

Exit code 1 if this machine cannot train. A missing COLMAP or ffmpeg is only reported: both can be avoided.")]
pub struct Arguments {
    /// Check the first adapter whose name contains this (ignoring case).
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// The COLMAP to look for: a program, `pycolmap`, or `pycolmap:PYTHON`.
    #[arg(long, value_name = "PROGRAM", default_value = "auto")]
    colmap: ColmapProgram,
}

#[derive(Serialize)]
struct Diagnosis {
    version: &'static str,
    threads: usize,
    adapters: Vec<String>,
    adapter: Option<AdapterReport>,
    /// Name and version.
    colmap: Option<String>,
    /// Version.
    ffmpeg: Option<String>,
    /// What keeps erfgs from training here.
    problems: Vec<String>,
    /// What is worth knowing or installing.
    remarks: Vec<String>,
}

#[derive(Serialize)]
struct AdapterReport {
    name: String,
    kind: String,
    backend: String,
    driver: String,
    kernels: &'static str,
    maps_in_place: bool,
    storage_binding_bytes: u64,
    buffer_bytes: u64,
    workgroup_storage_bytes: u32,
    workgroup_invocations: u32,
    storage_buffers_per_stage: u32,
    canary: bool,
}

/// Prints the diagnosis; fails where training is not possible.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let diagnosis = examine(arguments);
    terminal.result(&diagnosis, || describe(&diagnosis))?;
    if !diagnosis.problems.is_empty() {
        bail!("this machine cannot train yet: {}", diagnosis.problems.join("; "));
    }
    Ok(())
}

fn examine(arguments: &Arguments) -> Diagnosis {
    let mut problems = Vec::new();
    let mut remarks = Vec::new();
    let adapter = match examine_adapter(arguments) {
        Ok((report, wrong)) => {
            problems.extend(wrong.map(|error| error.to_string()));
            if report.kernels == "cpu" {
                remarks.push("no GPU is in use: training runs on the CPU through a software driver".into());
            }
            Some(report)
        }
        Err(error) => {
            problems.push(error.to_string());
            None
        }
    };
    let colmap = Colmap::find(&arguments.colmap).map(|colmap| colmap.version());
    remarks.extend(colmap.as_ref().err().map(ToString::to_string));
    let ffmpeg = ffmpeg_version();
    if ffmpeg.is_none() {
        remarks.push(
            "ffmpeg is missing: importing video files and writing MP4 need it (Debian, Ubuntu: apt install ffmpeg); \
             image folders and PNG do without"
                .into(),
        );
    }
    Diagnosis {
        version: env!("CARGO_PKG_VERSION"),
        threads: std::thread::available_parallelism().map_or(1, usize::from),
        adapters: adapters().into_iter().map(|info| format!("{} ({:?})", info.name, info.backend)).collect(),
        adapter,
        colmap: colmap.ok(),
        ffmpeg,
        problems,
        remarks,
    }
}

/// The adapter that training would use, and what is wrong with it.
fn examine_adapter(arguments: &Arguments) -> Result<(AdapterReport, Option<GpuError>), GpuError> {
    let gpu = Gpu::open(&AdapterChoice { name: arguments.adapter.clone(), shape: None })?;
    let wrong = run_canary(&gpu).err();
    let (info, limits) = (&gpu.info, &gpu.limits);
    let report = AdapterReport {
        name: info.name.clone(),
        kind: format!("{:?}", info.device_type),
        backend: format!("{:?}", info.backend),
        driver: [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned(),
        kernels: match gpu.shape {
            Shape::Gpu => "gpu",
            Shape::Cpu => "cpu",
        },
        maps_in_place: gpu.mappable,
        storage_binding_bytes: limits.max_storage_buffer_binding_size,
        buffer_bytes: limits.max_buffer_size,
        workgroup_storage_bytes: limits.max_compute_workgroup_storage_size,
        workgroup_invocations: limits.max_compute_invocations_per_workgroup,
        storage_buffers_per_stage: limits.max_storage_buffers_per_shader_stage,
        canary: wrong.is_none(),
    };
    Ok((report, wrong))
}

fn ffmpeg_version() -> Option<String> {
    let mut command = Command::new("ffmpeg");
    command.arg("-version");
    let text = answer(command, Duration::from_secs(30), 1 << 20).ok()?.out;
    text.strip_prefix("ffmpeg version ")?.split_whitespace().next().map(str::to_owned)
}

fn describe(diagnosis: &Diagnosis) -> String {
    let mut rows = vec![("erfgs", diagnosis.version.to_owned())];
    if let Some(adapter) = &diagnosis.adapter {
        rows.extend([
            ("adapter", format!("{} ({}, {})", adapter.name, adapter.kind, adapter.backend)),
            ("driver", adapter.driver.clone()),
            ("kernels", adapter.kernels.to_owned()),
            (
                "limits",
                format!(
                    "{} a binding, {} a buffer, {} bindings a stage; workgroups of {} threads with {}",
                    bytes(adapter.storage_binding_bytes),
                    bytes(adapter.buffer_bytes),
                    adapter.storage_buffers_per_stage,
                    adapter.workgroup_invocations,
                    bytes(adapter.workgroup_storage_bytes.into()),
                ),
            ),
            ("canary", if adapter.canary { "alive: long loops run to their end" } else { "DEAD" }.to_owned()),
        ]);
    }
    rows.push(("all adapters", diagnosis.adapters.join(", ")));
    rows.push(("CPU threads", diagnosis.threads.to_string()));
    for (name, version) in [("COLMAP", &diagnosis.colmap), ("ffmpeg", &diagnosis.ffmpeg)] {
        rows.push((name, version.clone().unwrap_or_else(|| "not found".into())));
    }
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect();
    let mut text = table(&rows);
    for (title, lines) in [("problem", &diagnosis.problems), ("remark", &diagnosis.remarks)] {
        for line in lines {
            text.push_str(&format!("\n{title}: {line}\n"));
        }
    }
    if diagnosis.problems.is_empty() {
        text.push_str("\nready to train\n");
    }
    text
}
