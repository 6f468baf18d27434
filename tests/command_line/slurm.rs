//! A Slurm of one controller and two nodes on this machine: no systemd, no cgroups, the loopback only.

use std::{
    fs,
    net::TcpListener,
    path::PathBuf,
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

/// A cluster that ends when it is dropped.
pub struct Cluster {
    folder: tempfile::TempDir,
    /// What was started here, by its name.
    started: Vec<(String, Child)>,
}

const PROGRAMS: [&str; 3] = ["munged", "slurmctld", "slurmd"];

impl Cluster {
    /// Starts one.
    pub fn start() -> Self {
        for program in PROGRAMS {
            let path = PathBuf::from("/usr/sbin").join(program);
            assert!(path.is_file(), "{} is missing: `scripts/setup.sh --slurm` installs it", path.display());
        }
        let mut this = Self { folder: tempfile::tempdir().expect("a folder"), started: Vec::new() };
        this.configure();
        let path = |name: &str| this.path(name).display().to_string();
        let munge = [
            "--force".to_owned(),
            "--foreground".into(),
            format!("--key-file={}", path("key")),
            format!("--socket={}", path("run/munge")),
            format!("--pid-file={}", path("munged.pid")),
            format!("--log-file={}", path("munged.log")),
            format!("--seed-file={}", path("munge.seed")),
        ];
        this.daemon("munged", &munge);
        this.wait("munged", |this| this.path("run/munge").exists());
        this.daemon("slurmctld", &["-D".into()]);
        this.wait("a controller", |this| this.stdout("scontrol", "ping").contains("UP"));
        for node in ["n1", "n2"] {
            this.daemon("slurmd", &["-D".into(), "-N".into(), node.into()]);
        }
        this.wait("two idle nodes", |this| this.stdout("sinfo", "-N -h -p low -t idle -o %N").lines().count() == 2);
        this
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `SLURM_CONF`.
    pub fn configuration(&self) -> PathBuf {
        self.path("slurm.conf")
    }

    fn configure(&mut self) {
        use std::os::unix::fs::PermissionsExt;
        for folder in ["run", "state", "spool.n1", "spool.n2"] {
            fs::create_dir_all(self.path(folder)).expect("a folder");
        }
        // munged wants nobody else to be able to change what lies above its socket.
        for folder in ["", "run"] {
            fs::set_permissions(self.path(folder), fs::Permissions::from_mode(0o755)).expect("permissions");
        }
        let key: Vec<u8> = (0..1024u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        fs::write(self.path("key"), key).expect("a key");
        fs::set_permissions(self.path("key"), fs::Permissions::from_mode(0o400)).expect("permissions");
        // All at once, so that no two are the same.
        let free = [(); 3].map(|()| TcpListener::bind("127.0.0.1:0").expect("a port"));
        let [controller, first, second] = free.map(|port| port.local_addr().expect("an address").port());
        let user = Command::new("id").arg("-un").output().expect("a user").stdout;
        let user = String::from_utf8_lossy(&user).trim().to_owned();
        let host = fs::read_to_string("/proc/sys/kernel/hostname").expect("a name");
        let host = host.trim().split('.').next().unwrap_or_default().to_owned();
        let d = self.folder.path().display();
        // Not those of another cluster on this machine.
        let first_job = 10_000 + std::process::id() % 50_000 * 100;
        let text = format!(
            "ClusterName=erfgs\nSlurmctldHost={host}(127.0.0.1)\nSlurmctldPort={controller}\nSlurmUser={user}\nSlurmdUser={user}\n\
             AuthType=auth/munge\nAuthInfo=socket={d}/run/munge\nCryptoType=crypto/munge\nStateSaveLocation={d}/state\n\
             SlurmdSpoolDir={d}/spool.%n\nSlurmctldPidFile={d}/run/slurmctld.pid\nSlurmdPidFile={d}/run/slurmd.%n.pid\n\
             SlurmctldLogFile={d}/slurmctld.log\nSlurmdLogFile={d}/slurmd.%n.log\nMpiDefault=none\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
             AccountingStorageType=accounting_storage/none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_Core\n\
             SchedulerParameters=sched_interval=1,bf_interval=1\nSlurmdParameters=config_overrides\nReturnToService=2\n\
             SlurmctldTimeout=30\nSlurmdTimeout=4\nMessageTimeout=4\nTCPTimeout=1\nCompleteWait=0\nKillWait=5\n\
             MinJobAge=600\nFirstJobId={first_job}\nJobRequeue=1\nPreemptType=preempt/partition_prio\nPreemptMode=REQUEUE\n\
             NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1 RealMemory=1000\n\
             NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1 RealMemory=1000\n\
             PartitionName=low Nodes=n1,n2 Default=YES MaxTime=INFINITE PriorityTier=1 PreemptMode=REQUEUE GraceTime=30\n\
             PartitionName=high Nodes=n1,n2 MaxTime=INFINITE PriorityTier=10 PreemptMode=OFF\n"
        );
        fs::write(self.configuration(), text).expect("a configuration");
        fs::write(self.path("cgroup.conf"), "CgroupAutomount=no\n").expect("a configuration");
    }

    fn daemon(&mut self, program: &str, words: &[String]) {
        let mut command = Command::new(format!("/usr/sbin/{program}"));
        command.args(words).env("SLURM_CONF", self.configuration());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let name = words.last().filter(|_| program == "slurmd").map_or(program, String::as_str);
        self.started.push((name.to_owned(), command.spawn().expect("a daemon")));
    }

    fn wait(&self, what: &str, there: impl Fn(&Self) -> bool) {
        let until = Instant::now() + Duration::from_secs(60);
        while !there(self) {
            let log = fs::read_to_string(self.path("slurmctld.log")).unwrap_or_default();
            assert!(Instant::now() < until, "Slurm does not get to {what}\n{log}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// A command of Slurm.
    pub fn ask(&self, program: &str, words: &str) -> Output {
        let mut command = Command::new(program);
        command.args(words.split_whitespace()).env("SLURM_CONF", self.configuration());
        command.output().expect("a command of Slurm")
    }

    /// What it says.
    pub fn stdout(&self, program: &str, words: &str) -> String {
        String::from_utf8_lossy(&self.ask(program, words).stdout).into_owned()
    }

    /// Submits a job that takes a node away from what runs on it, for a second.
    pub fn preempt(&self, node: &str) {
        let script = self.path("urgent.sh");
        fs::write(&script, "#!/bin/bash\nsleep 1\n").expect("a script");
        let words = format!("--partition=high --nodelist={node} --output=/dev/null {}", script.display());
        let output = self.ask("sbatch", &words);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }

    /// Jobs that were put back into the queue wait for two minutes, in case their node is in trouble. They need not here.
    pub fn hurry(&self) {
        for id in self.stdout("squeue", "-h -r -t PENDING -o %F_%K/%r").lines() {
            if let Some((id, "BeginTime")) = id.split_once('/') {
                self.ask("scontrol", &format!("update JobId={id} StartTime=now"));
            }
        }
    }

    /// Ends a node as a power failure does: its daemon and all that runs on it.
    pub fn kill_node(&self, node: &str) {
        let daemon = self.started.iter().find(|(name, _)| name == node).expect("a node").1.id();
        let jobs = self.stdout("squeue", &format!("-h -w {node} -o %A"));
        let processes = processes();
        let of_jobs = processes.iter().filter(|process| jobs.lines().any(|job| process.is_of(job.trim())));
        let mut victims = vec![daemon];
        let of_jobs: Vec<u32> = of_jobs.map(|process| process.id).collect();
        assert!(!of_jobs.is_empty(), "nothing runs on {node}");
        victims.extend(&of_jobs);
        let mut parents = of_jobs;
        while let Some(parent) = parents.pop() {
            let children = processes.iter().filter(|process| process.parent == parent).map(|process| process.id);
            let children: Vec<u32> = children.collect();
            victims.extend(&children);
            parents.extend(children);
        }
        kill(&victims);
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let jobs: Vec<String> = self.stdout("squeue", "-h -o %A").lines().map(|job| job.trim().to_owned()).collect();
        self.ask("scancel", "--me");
        let left = || processes().into_iter().filter(|process| jobs.iter().any(|job| process.is_of(job)));
        let until = Instant::now() + Duration::from_secs(5);
        while Instant::now() < until && left().next().is_some() {
            std::thread::sleep(Duration::from_millis(50));
        }
        kill(&left().map(|process| process.id).collect::<Vec<_>>());
        for (_, daemon) in &mut self.started {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

struct Process {
    id: u32,
    parent: u32,
    command: String,
}

impl Process {
    /// Whether it is what Slurm keeps beside a step of a job. Numbers of jobs are our own.
    fn is_of(&self, job: &str) -> bool {
        self.command.starts_with(&format!("slurmstepd: [{job}."))
    }
}

fn processes() -> Vec<Process> {
    let output = Command::new("ps").args(["-eo", "pid=,ppid=,args="]).output().expect("ps");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let process = |line: &str| {
        let mut fields = line.split_whitespace();
        let (id, parent) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
        Some(Process { id, parent, command: fields.collect::<Vec<_>>().join(" ") })
    };
    text.lines().filter_map(process).collect()
}

fn kill(processes: &[u32]) {
    let ids = processes.iter().map(u32::to_string);
    let _ = Command::new("kill").arg("-KILL").args(ids).stderr(Stdio::null()).status();
}
