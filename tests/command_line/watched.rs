//! `erfgs train --live`: a training that someone watches, saves and stops from a page.

use std::{
    process::Stdio,
    time::{Duration, Instant},
};

use super::{
    Folder,
    browser::Browser,
    page::{Page, Program, film_small, header, lines},
};

/// Asks until `holds` of the state of the training.
fn wait(page: &Page, what: &str, holds: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
    let until = Instant::now() + Duration::from_secs(120);
    loop {
        let state = page.json("/api/training");
        if holds(&state) {
            return state;
        }
        assert!(Instant::now() < until, "{what}: {state}");
        std::thread::yield_now();
    }
}

#[test]
fn a_training_is_watched_saved_and_stopped_from_its_page() {
    let folder = Folder::new();
    film_small(&folder);
    let words = "train ds --out run --iterations 50+100000 --live 127.0.0.1:0 --set evaluation.log_every=10 \
                 --set evaluation.checkpoint_every=0";
    let mut command = folder.command(words);
    let mut program = Program(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("erfgs starts"));
    let stderr = lines(program.0.stderr.take().expect("stderr"));
    let link = loop {
        let line = stderr.recv_timeout(Duration::from_secs(60)).expect("a link");
        if let Some((_, link)) = line.split_once("watched at ") {
            break link.trim().to_owned();
        }
    };
    let page = Page { link };
    let models = page.json("/api/models");
    assert_eq!((&models[0]["training"], &models[0]["from_run"]), (&true.into(), &true.into()));
    let first = header(&page.get("/api/scene/0").1);
    assert_eq!(first["motion"]["kind"], "still", "nothing moves before the fine stage");

    // A browser shows it, without a graphics processor: pictures that the trainer draws between two iterations.
    let mut browser = Browser::unseen();
    browser.open(&format!("{}&renderer=server", page.link));
    browser.wait("document.body?.dataset.drawn > 0");
    browser.wait("Number(document.getElementById('training').dataset.version) >= 1");
    let text = browser.evaluate("document.querySelector('[data-part=now]').textContent").to_string();
    assert!(text.contains("fine iteration") && text.contains("Gaussians") && text.contains("left"), "{text}");
    // The curves are drawn, in more colours than the ground's.
    let colours = "(() => { const c = document.querySelector('[data-part=curves]'); \
                   const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
                   const seen = new Set(); for (let i = 0; i < p.length; i += 4) if (p[i + 3] > 200) seen.add(p[i] >> 4); \
                   return seen.size; })()";
    browser.wait(&format!("{colours} >= 3"));

    let state = wait(&page, "rows with losses and quality", |state| {
        let rows = state["rows"].as_array().expect("rows");
        rows.iter().any(|row| row["loss_event"].is_number()) && rows.iter().any(|row| row["psnr"].is_number())
    });
    assert!(state["left_seconds"].as_f64().expect("a time") > 0.0);
    let rows = state["rows"].as_array().expect("rows").len();
    let later = page.json(&format!("/api/training?rows={rows}"));
    let newer = later["rows"].as_array().expect("rows");
    assert!(newer.iter().all(|row| row["iteration"].as_u64() > state["rows"][rows - 1]["iteration"].as_u64()));
    let scene = header(&page.get("/api/scene/0").1);
    assert_eq!(scene["motion"]["kind"], "free-time", "the scene that is shown has learned to move");

    // Who does not know the token changes nothing, and another site's page neither.
    assert_eq!(page.ask("POST", "/api/training/stop", "", &[]).0, 401);
    let (host, token) = page.parts();
    let port = host.rsplit(':').next().expect("a port");
    let elsewhere = format!("Cookie: erfgs_token_{port}={token}\r\nOrigin: http://elsewhere.example\r\n");
    assert_eq!(page.ask("POST", "/api/training/stop", &elsewhere, &[]).0, 403);
    assert_eq!(page.known("POST", "/api/training/dance").0, 404);
    assert!(!folder.path("run/checkpoint.bin").exists());
    browser.evaluate("document.querySelector('[data-part=save]').click()");
    wait(&page, "a checkpoint", |state| state["saved"].is_u64());
    browser.wait("document.querySelector('[data-part=wish]').textContent.includes('a checkpoint was saved')");
    // The page is told as the iteration ends in which it is written.
    let until = Instant::now() + Duration::from_secs(30);
    while !folder.path("run/checkpoint.bin").is_file() {
        assert!(Instant::now() < until, "no checkpoint");
        std::thread::yield_now();
    }

    assert_eq!(page.known("POST", "/api/training/stop").0, 202);
    browser.wait("document.querySelector('[data-part=now]').textContent.includes('stopped')");
    assert_eq!(program.0.wait().expect("an end").code(), Some(130));
    let rest: String = stderr.iter().collect();
    assert!(rest.contains("--resume"), "{rest}");
    // What was learned goes on being seen, and the run can be opened.
    assert_eq!(browser.evaluate("document.getElementById('trouble').textContent"), "");
    assert!(
        folder.figures("info run")["iterations"].as_u64().is_some_and(|done| done > 50),
        "{}",
        folder.figures("info run")
    );
}
