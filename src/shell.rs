//! What a shell and `man` know of the program: completions and manual pages.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use erfgs_base::{FileError, atomic};

use crate::terminal::Terminal;

/// Options of `erfgs completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs completions bash > ~/.local/share/bash-completion/completions/erfgs
  erfgs completions zsh > ~/.zfunc/_erfgs
  erfgs completions fish > ~/.config/fish/completions/erfgs.fish")]
pub struct CompletionsArguments {
    /// The shell.
    shell: Shell,
}

/// Options of `erfgs man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  erfgs man ~/.local/share/man/man1
  erfgs man /tmp/pages && man -l /tmp/pages/erfgs-train.1")]
pub struct ManArguments {
    /// The folder that the pages are written into; it is made where needed, and pages of these names are replaced.
    folder: PathBuf,
}

/// Prints the completions of a shell.
pub fn completions(arguments: &CompletionsArguments, mut program: Command, terminal: &Terminal) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut program, "erfgs", &mut script);
    terminal.raw(&script)
}

/// Writes a page for the program and one for each of its commands.
pub fn man(arguments: &ManArguments, program: Command, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = &arguments.folder;
    std::fs::create_dir_all(folder).map_err(FileError::when("make the folder", folder))?;
    // Pages of commands are told apart by their whole names: erfgs-dataset-import.
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    write(&program, folder, &mut pages)?;
    terminal.result(&serde_json::json!({ "folder": folder, "pages": pages }), || {
        format!("{} pages in {}", pages.len(), folder.display())
    })
}

fn write(command: &Command, folder: &Path, pages: &mut Vec<String>) -> anyhow::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        write(below, folder, pages)?;
    }
    let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
    let file = format!("{name}.1");
    let path = folder.join(&file);
    let mut page = Vec::new();
    let source = concat!("erfgs ", env!("CARGO_PKG_VERSION"));
    Man::new(command.clone())
        .title(&name)
        .source(source)
        .manual("erfgs")
        .render(&mut page)
        .context("cannot write a manual page")?;
    atomic::write(&path, &page).map_err(FileError::when("write", &path))?;
    pages.push(file);
    Ok(())
}
