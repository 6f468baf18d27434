// From the gradients of the deltas to those of the rows. The gradient of the sum of logit and delta has been added to the
// stored logit's already; what is added here is how the delta itself depends on the logit. An instant moves only for the
// sake of the presence: with a velocity it would slide its Gaussian along the trajectory instead.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read> d_delta_core: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> d_core: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> d_values: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let begin = ((group.y * groups.x + group.x) * THREADS + thread) * PER_THREAD;
    for (var row = begin; row < min(begin + PER_THREAD, moment.rows); row++) {
        let s = state_of(moment, core[3u * row + 2u].z, row);
        straighten(row, moment.acceleration);
        if !s.there {
            continue;
        }
        let d_mean = d_delta_core[3u * row].xyz;
        let d_logit = d_delta_core[3u * row + 2u].z;
        let opacity = s.odds / (1.0 + s.odds);
        let regular = moment.presence * s.presence * opacity * (1.0 - opacity);
        d_core[3u * row + 2u].z += d_logit * (1.0 - s.left) / s.left + regular;
        let d_log_presence = moment.path * d_logit * (1.0 + s.odds * s.presence / s.left);
        let per_life = s.u / s.life;
        move_path(row, s.dt, d_mean);
        d_values[VECTORS * row].w += d_log_presence * per_life;
        d_values[VECTORS * row + 1u].w += d_log_presence * s.u * per_life * (s.life - moment.least);
    }
}
