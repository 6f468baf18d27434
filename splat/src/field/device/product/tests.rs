use erfgs_base::random;

use super::*;
use crate::gpu::{AdapterChoice, Shape};

/// Uniform numbers in [-1, 1).
fn noise(seed: u64, count: usize) -> Vec<f32> {
    (0..count as u64).map(|i| random::range(random::key(seed, &[i]), -1.0, 1.0) as f32).collect()
}

/// Where row `i`, column `j` of `place` lies.
fn at(place: Place<'_>, i: usize, j: usize) -> usize {
    place.offset + i * place.row + j * place.col
}

/// Values of a matrix that lies within others', and what lies around it.
struct Within {
    values: Vec<f32>,
    offset: usize,
    stride: usize,
}

impl Within {
    fn new(seed: u64, rows: usize, columns: usize) -> Self {
        let (offset, stride) = (seed as usize, columns + 3);
        Self { values: noise(seed, offset + rows * stride), offset, stride }
    }

    fn place<'a>(&self, buffer: &'a Buffer) -> Place<'a> {
        Place::new(buffer, self.offset, self.stride)
    }
}

#[test]
fn products_of_every_tile_follow_plain_sums() {
    let gpu = Gpu::open(&AdapterChoice { shape: Some(Shape::Gpu), ..Default::default() }).expect("an adapter");
    // Up to 16, up to 64 and more columns; one tile, several along each side, and several slabs.
    let sizes =
        [[1, 4, 3], [300, 32, 128], [130, 128, 200], [1100, 130, 48], [515, 128, 1], [129, 17, 16], [70, 300, 65]];
    let products = Products::new(&gpu, 0).expect("room");
    let all = sizes.map(|size| (&products, size));
    // What graphics processors run, wherever this is: of the narrowest tile, which is compiled in seconds.
    let written_out = Products::with(&gpu, 0, WRITTEN_OUT).expect("room");
    let narrow = [(&written_out, [515, 16, 1]), (&written_out, [129, 14, 16])];
    for (products, [rows, inputs, outputs]) in all.into_iter().chain(narrow) {
        let case = format!("{rows} rows of {inputs} to {outputs}");
        let layer = Layer { inputs, outputs, weight: 5, bias: 5 + inputs * outputs + 7 };
        let parameters = noise(1, layer.bias + outputs);
        let (x, d, mask) = (Within::new(2, rows, inputs), Within::new(3, rows, outputs), Within::new(4, rows, inputs));
        let mask = Within { values: mask.values.iter().map(|value| value.max(0.0)).collect(), ..mask };
        let buffer = |values: &[f32]| gpu.storage_from("values", values).expect("room");
        let [weights, xs, ds, masks] = [&parameters, &x.values, &d.values, &mask.values].map(|values| buffer(values));
        let [out, d_x, d_masked, gradients] =
            [&d.values, &x.values, &x.values, &parameters].map(|values| buffer(values));
        let mut commands = gpu.commands();
        let parts = (layer, &weights);
        products.layer(&mut commands, parts, rows, x.place(&xs), d.place(&out), true);
        products.input_gradient(&mut commands, parts, rows, d.place(&ds), x.place(&d_x), None);
        let masked = Some(mask.place(&masks));
        products.input_gradient(&mut commands, parts, rows, d.place(&ds), x.place(&d_masked), masked);
        products.weight_gradient(&mut commands, (layer, &gradients), rows, d.place(&ds), x.place(&xs));
        commands.submit();
        let read = |buffer: &Buffer, count: usize| gpu.download::<f32>(buffer, count).expect("a read back");
        let value = |from: &[f32], place: usize| f64::from(from[place]);
        let weight = |input: usize, output: usize| value(&parameters, layer.weight + output * inputs + input);
        let close = |is: f64, should: f64, terms: usize, what: &str| {
            let bound = 1e-6 * (terms as f64 + 10.0);
            assert!((is - should).abs() < bound, "{what}, {case}: {is} and {should}");
        };
        let (x_at, d_at) = (x.place(&xs), d.place(&ds));

        // What lies around a matrix stays.
        let (mut expected_out, got) = (d.values.clone(), read(&out, d.values.len()));
        let (mut expected_x, got_x) = (x.values.clone(), read(&d_x, x.values.len()));
        let got_masked = read(&d_masked, x.values.len());
        let mut expected_masked = x.values.clone();
        for row in 0..rows {
            for output in 0..outputs {
                let products = (0..inputs).map(|input| value(&x.values, at(x_at, row, input)) * weight(input, output));
                let sum = products.sum::<f64>() + value(&parameters, layer.bias + output);
                close(value(&got, at(d_at, row, output)), sum.max(0.0), inputs, "layer");
                expected_out[at(d_at, row, output)] = got[at(d_at, row, output)];
            }
            for input in 0..inputs {
                let products =
                    (0..outputs).map(|output| value(&d.values, at(d_at, row, output)) * weight(input, output));
                let (sum, place) = (products.sum::<f64>(), at(x_at, row, input));
                close(value(&got_x, place), sum, outputs, "gradient of the input");
                let kept = if mask.values[at(mask.place(&masks), row, input)] == 0.0 { 0.0 } else { sum };
                close(value(&got_masked, place), kept, outputs, "masked gradient of the input");
                (expected_x[place], expected_masked[place]) = (got_x[place], got_masked[place]);
            }
        }
        assert_eq!((got, got_x, got_masked), (expected_out, expected_x, expected_masked), "{case}");

        // Gradients are added to what was there, which were the parameters.
        let got = read(&gradients, parameters.len());
        let mut expected = parameters.clone();
        for output in 0..outputs {
            let column = |row: usize| value(&d.values, at(d_at, row, output));
            for input in 0..inputs {
                let products = (0..rows).map(|row| column(row) * value(&x.values, at(x_at, row, input)));
                let place = layer.weight + output * inputs + input;
                close(
                    value(&got, place),
                    value(&parameters, place) + products.sum::<f64>(),
                    rows,
                    "gradient of a weight",
                );
                expected[place] = got[place];
            }
            let place = layer.bias + output;
            close(
                value(&got, place),
                value(&parameters, place) + (0..rows).map(column).sum::<f64>(),
                rows,
                "gradient of a bias",
            );
            expected[place] = got[place];
        }
        assert_eq!(got, expected, "{case}");
    }
}
