//! Stops and kills a process that writes files and runs another program, and looks at what is left of it.
//!
//! The process is this program itself, started with `work`: it has a scratch folder, a file and a folder that are not whole, and a
//! child, and says so on its standard output.

#[cfg(not(target_os = "linux"))]
fn main() {}

#[cfg(target_os = "linux")]
fn main() {
    linux::main();
}

#[cfg(target_os = "linux")]
mod linux {
    use std::{
        env, fs,
        io::{BufRead, BufReader, Write},
        path::{Path, PathBuf},
        process::{Child, Command, Stdio},
        time::{Duration, Instant},
    };

    use erfgs_base::{
        atomic::{self, NewFolder, Place},
        children, ending,
        scratch::Scratch,
    };

    pub fn main() {
        let arguments: Vec<String> = env::args().collect();
        match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
            [_, "work", folder] => work(Path::new(folder)),
            // Test runners ask for the list of tests.
            [_, rest @ ..] if rest.contains(&"--list") => {
                println!("what_is_stopped_leaves_nothing: test\nwhat_a_killed_process_left_is_removed_next_time: test");
            }
            _ => {
                what_is_stopped_leaves_nothing();
                what_a_killed_process_left_is_removed_next_time();
            }
        }
    }

    /// Begins everything, says so, and waits for a line: then it ends as a program does that was asked to stop.
    fn work(folder: &Path) {
        let scratch = Scratch::new().unwrap();
        fs::create_dir(scratch.path().join("deep")).unwrap();
        fs::write(scratch.path().join("deep/picture"), b"private").unwrap();
        let begun = NewFolder::begin(&folder.join("dataset")).unwrap();
        fs::write(begun.path().join("half"), b"half").unwrap();
        let video = Place::begin(&folder.join("video.mp4")).unwrap();
        fs::write(video.path(), b"half").unwrap();
        let (sender, is_begun) = std::sync::mpsc::channel();
        std::thread::spawn({
            let path = folder.join("events.csv");
            move || {
                atomic::write_with(&path, |file| {
                    file.write_all(b"half")?;
                    sender.send(()).unwrap();
                    loop {
                        std::thread::park();
                    }
                })
            }
        });
        is_begun.recv().unwrap();
        let id = scratch.path().join("id");
        let mut child = Command::new("sh");
        child.args(["-c", &format!("echo $$ > '{0}.part'; mv '{0}.part' '{0}'; exec sleep 600", id.display())]);
        std::thread::spawn(move || children::run(child, Duration::from_secs(600), |_| {}));
        until("the child runs", || id.exists());
        println!("{}", fs::read_to_string(&id).unwrap().trim());
        std::io::stdin().read_line(&mut String::new()).unwrap();
        ending::clear();
        std::process::exit(130);
    }

    fn names(folder: &Path) -> Vec<PathBuf> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
    }

    fn until(what: &str, mut is_so: impl FnMut() -> bool) {
        let begun = Instant::now();
        while !is_so() {
            assert!(begun.elapsed() < Duration::from_secs(120), "{what}: not in two minutes");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// A process at work, and the number of its child.
    fn started(folder: &Path, temporary: &Path) -> (Child, String) {
        let mut process = Command::new(env::current_exe().unwrap())
            .arg("work")
            .arg(folder)
            .env("TMPDIR", temporary)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut id = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut id).unwrap();
        (process, id.trim().to_owned())
    }

    fn is_gone(id: &str) -> bool {
        let stat = fs::read_to_string(format!("/proc/{id}/stat"));
        // Where nobody waits for what is left, it stays as a dead process.
        stat.map_or(true, |stat| stat.contains(") Z ") || stat.contains(") X "))
    }

    fn what_is_stopped_leaves_nothing() {
        let (folder, temporary) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (mut process, child) = started(folder.path(), temporary.path());
        assert_eq!((names(folder.path()).len(), names(temporary.path()).len()), (3, 1));
        process.stdin.take().unwrap().write_all(b"stop\n").unwrap();
        assert_eq!(process.wait().unwrap().code(), Some(130));
        until("the child ends", || is_gone(&child));
        assert!(names(folder.path()).is_empty(), "{:?}", names(folder.path()));
        assert!(names(temporary.path()).is_empty(), "{:?}", names(temporary.path()));
    }

    fn what_a_killed_process_left_is_removed_next_time() {
        let (folder, temporary) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (mut process, child) = started(folder.path(), temporary.path());
        process.kill().unwrap();
        process.wait().unwrap();
        until("the child ends", || is_gone(&child));
        assert_eq!((names(folder.path()).len(), names(temporary.path()).len()), (3, 1));
        for file in ["video.mp4", "dataset", "events.csv"] {
            assert!(!folder.path().join(file).exists(), "{file} was not whole");
        }
        // The next one works there at the same time as another, and takes nothing of it.
        let (mut other, _) = started(folder.path(), temporary.path());
        assert_eq!((names(folder.path()).len(), names(temporary.path()).len()), (3, 1));
        let (mut process, _) = started(folder.path(), temporary.path());
        assert_eq!((names(folder.path()).len(), names(temporary.path()).len()), (6, 2));
        for process in [&mut process, &mut other] {
            process.stdin.take().unwrap().write_all(b"stop\n").unwrap();
            assert_eq!(process.wait().unwrap().code(), Some(130));
        }
        assert!(names(folder.path()).is_empty(), "{:?}", names(folder.path()));
        assert!(names(temporary.path()).is_empty(), "{:?}", names(temporary.path()));
    }
}
