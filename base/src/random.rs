//! Counter-based random numbers.
//!
//! A number is a pure function of a key, and a key is made from the seed, a word that says what the number is for, and
//! indices (camera, frame, pixel, Gaussian). No generator is carried along, so that results depend neither on threads
//! nor on the order of work.
//!
//! ```
//! use erfgs_base::random;
//! const PURPOSE_THRESHOLD: u64 = random::purpose("threshold");
//! let (seed, camera, pixel) = (7, 3, 1234);
//! let key = random::key(seed, &[PURPOSE_THRESHOLD, camera, pixel]);
//! let threshold = 0.2 + 0.03 * random::normal(key);
//! assert!(threshold.is_finite());
//! ```
//!
//! The mixing function is the finaliser of SplitMix64 (Steele, Lea, Flood 2014, "Fast splittable pseudorandom number
//! generators", variant 13 of Stafford's mixers), applied once for each word. It is fast and passes statistical tests;
//! it is no cipher.

/// The increment of SplitMix64: 2^64 divided by the golden ratio, made odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64's finaliser, a bijection of the 64-bit words.
#[inline]
#[must_use]
pub const fn mix(word: u64) -> u64 {
    let word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ (word >> 31)
}

/// A word for a purpose, from its name (FNV-1a), so that two uses of the same indices do not share numbers.
#[must_use]
pub const fn purpose(name: &str) -> u64 {
    let bytes = name.as_bytes();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(0x0100_0000_01b3);
        index += 1;
    }
    hash
}

/// The key of `seed` and `words` (purpose, camera, frame, pixel, ...). The order and the number of words matter.
#[inline]
#[must_use]
pub const fn key(seed: u64, words: &[u64]) -> u64 {
    let mut state = mix(seed.wrapping_add(GOLDEN));
    let mut index = 0;
    while index < words.len() {
        state = extend(state, words[index]);
        index += 1;
    }
    state
}

/// The key of one word more: `key(seed, &[a, b]) == extend(key(seed, &[a]), b)`.
///
/// An inner loop computes the common part once and extends it for each index.
#[inline]
#[must_use]
pub const fn extend(key: u64, word: u64) -> u64 {
    mix(key.wrapping_add(GOLDEN) ^ mix(word.wrapping_mul(GOLDEN).wrapping_add(GOLDEN)))
}

/// A uniform number in [0, 1), a multiple of 2^-53.
#[inline]
#[must_use]
pub const fn uniform(key: u64) -> f64 {
    (key >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// A uniform number in [`from`, `to`); `from` if the interval is empty.
#[must_use]
pub fn range(key: u64, from: f64, to: f64) -> f64 {
    if to > from { from + (to - from) * uniform(key) } else { from }
}

/// A uniform index below `count` (Lemire's multiplication; its bias is below `count` / 2^64); 0 if `count` is 0.
#[must_use]
pub const fn below(key: u64, count: u64) -> u64 {
    ((key as u128 * count as u128) >> 64) as u64
}

/// A standard normal number (Box-Muller on two uniform numbers drawn from the key).
#[must_use]
pub fn normal(key: u64) -> f64 {
    // 1 - uniform lies in (0, 1], where the logarithm is finite.
    let radius = (-2.0 * (1.0 - uniform(extend(key, 0))).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(extend(key, 1))).cos()
}

/// An exponential number of mean 1: the waiting time of a Poisson process of rate 1.
#[must_use]
pub fn exponential(key: u64) -> f64 {
    -(1.0 - uniform(key)).ln()
}

/// The indices 0..`count` in random order.
#[must_use]
pub fn permutation(key: u64, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        order.swap(last, below(extend(key, last as u64), last as u64 + 1) as usize);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix_matches_the_published_sequence() {
        // The first outputs of SplitMix64 from state 1234567 (the sequence that Rosetta Code and xoshiro's author print).
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423_u64];
        for (step, expected) in expected.into_iter().enumerate() {
            let state = 1_234_567_u64.wrapping_add(GOLDEN.wrapping_mul(step as u64 + 1));
            assert_eq!(mix(state), expected);
        }
    }

    #[test]
    fn keys_extend_word_by_word_and_depend_on_order_and_length() {
        assert_eq!(key(5, &[1, 2, 3]), extend(extend(key(5, &[1]), 2), 3));
        let keys = [key(5, &[]), key(5, &[0]), key(5, &[0, 0]), key(5, &[1, 2]), key(5, &[2, 1]), key(6, &[1, 2])];
        for (index, a) in keys.iter().enumerate() {
            assert!(keys[..index].iter().all(|b| a != b));
        }
    }

    #[test]
    fn moments_of_uniform_normal_and_exponential_are_right() {
        let count = 200_000;
        let (mut sums, root) = ([0.0_f64; 6], key(1, &[purpose("moments")]));
        for index in 0..count {
            let key = extend(root, index);
            let (u, n, e) = (uniform(key), normal(key), exponential(key));
            assert!((0.0..1.0).contains(&u));
            for (sum, value) in sums.iter_mut().zip([u, u * u, n, n * n, n * n * n * n, e]) {
                *sum += value / count as f64;
            }
        }
        // Five standard errors of each mean.
        let expected = [(0.5, 0.29), (1.0 / 3.0, 0.3), (0.0, 1.0), (1.0, 1.42), (3.0, 9.8), (1.0, 1.0)];
        for (sum, (mean, deviation)) in sums.into_iter().zip(expected) {
            assert!((sum - mean).abs() < 5.0 * deviation / (count as f64).sqrt(), "{sum} against {mean}");
        }
    }

    #[test]
    fn neighbouring_indices_are_uncorrelated() {
        let root = key(3, &[purpose("correlation")]);
        let count = 100_000_u64;
        let mut sum = 0.0;
        for index in 0..count {
            sum += normal(extend(root, index)) * normal(extend(root, index + 1));
        }
        assert!((sum / count as f64).abs() < 5.0 / (count as f64).sqrt());
    }

    #[test]
    fn a_permutation_holds_every_index_once() {
        let mut order = permutation(key(9, &[]), 1000);
        assert_ne!(order, (0..1000).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..1000).collect::<Vec<_>>());
        assert!(permutation(1, 0).is_empty());
    }

    #[test]
    fn empty_ranges_give_their_start() {
        assert_eq!(range(7, 2.0, 2.0), 2.0);
        assert_eq!(below(u64::MAX, 0), 0);
        assert_eq!(below(u64::MAX, 10), 9);
    }
}
