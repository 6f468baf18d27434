//! OpenCV's vector of distortion coefficients, of any length that its programs write.
//!
//! The order is k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, τx, τy, cut off after 4, 5, 8, 12 or 14 numbers. OpenCV writes all 14
//! whatever was calibrated; thin prisms (s) and tilted sensors (τ) have no place in our lenses, and are held as long as they are zero.

use crate::Distortion;

/// The terms that our lenses do not have.
const NOT_MODELLED: [&str; 6] = ["s1", "s2", "s3", "s4", "tau_x", "tau_y"];

/// The lens of OpenCV's standard model. All zero, or none at all, it is a pinhole.
pub(super) fn standard(k: &[f64]) -> Result<Distortion, String> {
    let terms = used(k);
    if terms.len() > 8 + NOT_MODELLED.len() {
        return Err(format!("{} distortion coefficients are not supported; OpenCV has 4, 5, 8, 12 or 14", k.len()));
    }
    let strange: Vec<String> = terms
        .iter()
        .skip(8)
        .zip(NOT_MODELLED)
        .filter(|(value, _)| **value != 0.0)
        .map(|(value, name)| format!("{name} = {value}"))
        .collect();
    if !strange.is_empty() {
        return Err(format!(
            "{} distortion coefficients are not supported where those behind the eighth are not zero ({}): our lenses have no thin \
             prism and no tilted sensor; calibrate without",
            k.len(),
            strange.join(", ")
        ));
    }
    if terms.is_empty() {
        return Ok(Distortion::None);
    }
    let mut all = [0.0; 8];
    all[..terms.len()].copy_from_slice(terms);
    Ok(Distortion::BrownConrady(all))
}

/// The lens of OpenCV's fisheye model: k1 to k4, and zeros behind them where a program writes all vectors equally long. All zero
/// it is the equidistant fisheye, no pinhole.
pub(super) fn fisheye(k: &[f64]) -> Result<Distortion, String> {
    match (k, used(k).len()) {
        (&[k1, k2, k3, k4, ..], 0..=4) => Ok(Distortion::KannalaBrandt([k1, k2, k3, k4])),
        _ => Err(format!(
            "{} distortion coefficients are not supported for a fisheye; it has 4: k1, k2, k3, k4",
            k.len()
        )),
    }
}

/// The coefficients up to the last that is not zero.
pub(super) fn used(k: &[f64]) -> &[f64] {
    &k[..k.iter().rposition(|value| *value != 0.0).map_or(0, |last| last + 1)]
}

/// Which of a document's `keys` holds the coefficients, which programs call by many names.
///
/// # Errors
/// If there are several.
pub(super) fn key<'a>(keys: impl Iterator<Item = &'a str>) -> Result<Option<&'a str>, String> {
    let found: Vec<&str> = keys.filter(|key| is_name(key)).take(2).collect();
    match found[..] {
        [] => Ok(None),
        [one] => Ok(Some(one)),
        [one, other, ..] => {
            let [one, other] = [one, other].map(|key| key.chars().take(40).collect::<String>());
            Err(format!("it has distortion coefficients twice, as {one} and as {other}; leave one of them out"))
        }
    }
}

/// Whether a key is a name of the coefficients.
pub(super) fn is_name(key: &str) -> bool {
    let plain: String = key.chars().filter(char::is_ascii_alphanumeric).take(40).collect();
    matches!(
        plain.to_ascii_lowercase().as_str(),
        "d" | "dist"
            | "distcoef"
            | "distcoefs"
            | "distcoeff"
            | "distcoeffs"
            | "distortion"
            | "distortions"
            | "distortioncoef"
            | "distortioncoefs"
            | "distortioncoeff"
            | "distortioncoeffs"
            | "distortioncoefficient"
            | "distortioncoefficients"
            | "distortionvector"
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn zeros_behind_a_lens_change_nothing_and_other_terms_are_named(
            k in prop::collection::vec(prop_oneof![Just(0.0), -0.3..0.3_f64], 0..=8),
            length in prop::sample::select(vec![8_usize, 12, 14]),
            strange in prop::option::of((8..14_usize, 1e-9..1.0_f64)),
        ) {
            let mut all = k.clone();
            all.resize(length.max(k.len()), 0.0);
            prop_assert_eq!(standard(&all), standard(&k));
            let Ok(lens) = standard(&k) else { return Err(TestCaseError::fail("refused")) };
            match lens {
                Distortion::BrownConrady(found) => prop_assert_eq!(&found[..k.len()], &k[..]),
                lens => prop_assert!(lens == Distortion::None && k.iter().all(|value| *value == 0.0)),
            }
            if let Some((at, value)) = strange {
                all.resize(14, 0.0);
                all[at] = value;
                let message = standard(&all).unwrap_err();
                prop_assert!(message.contains(NOT_MODELLED[at - 8]), "{message}");
            }
        }

        #[test]
        fn a_fisheye_has_four_and_zeros(k in prop::array::uniform4(-0.3..0.3_f64), zeros in 0..=10_usize, more in 1e-9..1.0_f64) {
            let mut all = k.to_vec();
            all.extend(std::iter::repeat_n(0.0, zeros));
            prop_assert_eq!(fisheye(&all), Ok(Distortion::KannalaBrandt(k)));
            prop_assert!(fisheye(&k[..3]).is_err());
            all.push(more);
            prop_assert!(fisheye(&all).is_err());
        }
    }

    #[test]
    fn names_of_coefficients_are_known_and_two_of_them_are_refused() {
        for name in ["dist_coeffs", "distCoeffs", "D", "distortion_coefficients", "distortions", "dist-coeff"] {
            assert_eq!(key(["K", name, "distortion_model"].into_iter()), Ok(Some(name)));
            assert!(key([name, "dist"].into_iter()).unwrap_err().contains(name));
        }
        assert_eq!(key(["distortion_model", "rows", "distance"].into_iter()), Ok(None));
    }
}
