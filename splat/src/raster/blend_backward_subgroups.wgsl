// As blend_backward_gpu.wgsl, where threads of a subgroup pass on what they know of a pixel without memory and barriers (GPU shape).
//
// LANES threads of a subgroup own as many pixels of the tile. Each thread owns a splat and visits these pixels one after the other,
// one step behind the thread before it, which owns the splat behind; after its pixels it goes on with the splat LANES entries further.
// In the step after a thread has seen the last of its pixels its sums lie in shared memory. Once all threads have come that far, the
// sums of all groups of LANES are added up.

// Of each pixel: dL/d colour as bits, and the entry at which it had become opaque.
var<workgroup> wanted: array<vec4u, PIXELS>;
// Transmittance in front of all entries; what lies behind them, weighted by dL/d image.
var<workgroup> behind_all: array<vec2f, PIXELS>;
// Of each group and lane.
var<workgroup> parts: array<f32, PIXELS * SUMS>;
var<workgroup> list: vec2u;
var<workgroup> furthest: atomic<u32>;

@compute @workgroup_size(PIXELS)
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_size) subgroup_size: u32,
    @builtin(subgroup_invocation_id) invocation: u32,
) {
    let tile = workgroup.y * workgroups.x + workgroup.x;
    if thread == 0u {
        list = vec2u(0u);
        if tile < view.size.z * view.size.w {
            list = lists[tile].yz;
        }
        atomicStore(&furthest, 0u);
    }
    let entry_range = workgroupUniformLoad(&list);
    let corner = TILE * vec2u(tile % view.size.z, tile / view.size.z);
    let own = corner + vec2u(thread % TILE, thread / TILE);
    let begun = pixel_of(own, entry_range.x);
    wanted[thread] = vec4u(bitcast<vec3u>(begun.d_colour), begun.stop);
    behind_all[thread] = vec2f(begun.transmittance, begun.behind);
    atomicMax(&furthest, begun.stop);
    let last = workgroupUniformLoad(&furthest);

    clear_sums(max(last, entry_range.x), entry_range.y, thread);
    let count = select(0u, last - entry_range.x, last > entry_range.x);
    // Until the last thread has seen its last pixel.
    let rounds = (count + LANES - 1u) / LANES;
    let steps = select(0u, (rounds + 1u) * LANES - 1u, count > 0u);
    let lane = invocation % LANES;
    let group = subgroup * (subgroup_size / LANES) + invocation / LANES;
    let before = invocation - lane + (lane + LANES - 1u) % LANES;
    // The splat that the thread goes on with, and whose the one after it is: asked for a round ahead, for memory answers late.
    var next = Splat();
    var next_owner = 0u;
    if lane < count {
        next = splats[owners[entries[last - 1u - lane]]];
    }
    if LANES + lane < count {
        next_owner = owners[entries[last - 1u - LANES - lane]];
    }
    var state = vec2f(1.0, 0.0);
    var splat = Splat();
    var v_sums = vec3f(0.0);
    var v_more = vec3f(0.0);
    var colour_sums = vec3f(0.0);
    for (var step = 0u; step < steps; step++) {
        let passed = vec2f(subgroupShuffle(state.x, before), subgroupShuffle(state.y, before));
        let turn = step - lane;
        let walked = (turn / LANES) * LANES + lane;
        if step >= lane && walked < count {
            let place = turn % LANES;
            let pixel = group * LANES + place;
            if place == 0u {
                splat = next;
                v_sums = vec3f(0.0);
                v_more = vec3f(0.0);
                colour_sums = vec3f(0.0);
            }
            state = passed;
            if walked == 0u {
                state = behind_all[pixel];
            }
            let position = vec2f(corner + vec2u(pixel % TILE, pixel / TILE)) + 0.5;
            let distance = position - splat.mean_power.xy;
            let alpha = alpha_of(splat, distance);
            let want = wanted[pixel];
            if alpha >= view.thresholds.x && last - 1u - walked < want.w {
                let d_colour = bitcast<vec3f>(want.xyz);
                let t = state.x / (1.0 - alpha);
                let contrast = dot(d_colour, splat.colour_depth.rgb) - state.y;
                state = vec2f(t, state.y + alpha * contrast);
                let weight = alpha * t;
                colour_sums += weight * d_colour;
                let v = weight * contrast;
                v_sums += v * vec3f(1.0, distance);
                v_more += v * vec3f(distance.x * distance.x, distance.x * distance.y, distance.y * distance.y);
            }
            if place == LANES - 1u {
                let at = SUMS * (group * LANES + lane);
                for (var i = 0u; i < 3u; i++) {
                    parts[at + i] = v_sums[i];
                    parts[at + 3u + i] = v_more[i];
                    parts[at + 6u + i] = colour_sums[i];
                }
            }
        }
        // The last thread has taken its splat of this round, the first goes on with the next.
        if step % LANES == LANES - 1u {
            let following = step + 1u + lane;
            if following < count {
                next = splats[next_owner];
            }
            if following + LANES < count {
                next_owner = owners[entries[last - 1u - following - LANES]];
            }
        }
        // The last thread has just ended the round before, the first is about to end this one.
        if step % LANES == (LANES - 2u) % LANES && step >= 2u * LANES - 2u {
            workgroupBarrier();
            let first = step - (2u * LANES - 2u);
            for (var value = thread; value < SUMS * LANES; value += PIXELS) {
                let done = first + value / SUMS;
                if done < count {
                    var sum = 0.0;
                    for (var part = value; part < SUMS * PIXELS; part += SUMS * LANES) {
                        sum += parts[part];
                    }
                    sums[SUMS * entries[last - 1u - done] + value % SUMS] = sum;
                }
            }
            workgroupBarrier();
        }
    }
}
