// A row of a Gaussian that is free in time, as it stands at a moment. Of its VECTORS vectors of `values` (those that its path needs, and what others keep behind them) the last number of the first is
// its instant, that of the second the logarithm of how much longer than the least it lives; the others are its path (parabola.wgsl,
// knots.wgsl).

struct Moment {
    rows: u32,
    time: f32,          // intervals
    least: f32,         // shortest life, intervals
    path: f32,          // how much of the gradient reaches instants and lives
    presence: f32,      // weight of the mean opacity of what is present / rows
    acceleration: f32,  // 2 weight of the mean squared acceleration / (rows extent^2)
    padding_a: u32,
    padding_b: u32,
}

struct State {
    dt: f32,        // since the row's instant, intervals
    life: f32,
    u: f32,         // dt / life
    presence: f32,
    odds: f32,      // of the stored opacity: o / (1 - o)
    left: f32,      // (1 - o presence) / (1 - o)
    d_logit: f32,   // change of the logit that makes the opacity o * presence, not less than GONE
    there: bool,
}

fn state_of(moment: Moment, logit: f32, row: u32) -> State {
    var s: State;
    s.dt = moment.time - values[VECTORS * row].w;
    // Bounded, so that no life or opacity overflows.
    s.life = moment.least + exp(clamp(values[VECTORS * row + 1u].w, -30.0, 30.0));
    s.u = s.dt / s.life;
    let log_presence = -0.5 * s.u * s.u;
    s.presence = exp(max(log_presence, -80.0));
    s.odds = exp(clamp(logit, -30.0, 30.0));
    // 1 - presence, without cancellation where the presence is nearly whole.
    var absent = 1.0 - s.presence;
    if log_presence > -1e-3 {
        absent = -log_presence * (1.0 + 0.5 * log_presence);
    }
    s.left = 1.0 + s.odds * absent;
    let wanted = log_presence - log(s.left);
    s.there = wanted > GONE;
    s.d_logit = select(GONE, wanted, s.there);
    return s;
}
