use proptest::prelude::*;

use super::*;

const EDGES: [Edge; 2] = [Edge::Cyclic, Edge::Mirrored];
const NORMALISATIONS: [Normalisation; 2] = [Normalisation::Energy, Normalisation::Amplitude];

type Operator<'a> = &'a dyn Fn(&mut [f32], usize);

/// Every transform of a size that there is.
fn all(size: (usize, usize)) -> impl Iterator<Item = Transform> {
    let edges = EDGES.iter().flat_map(|x| EDGES.iter().map(move |y| (*x, *y)));
    let kinds = edges.flat_map(|edges| NORMALISATIONS.iter().map(move |normalisation| (edges, *normalisation)));
    Wavelet::ALL.iter().flat_map(move |wavelet| {
        kinds
            .clone()
            .filter_map(move |(edges, normalisation)| Transform::new(*wavelet, size, edges, normalisation).ok())
    })
}

fn new(wavelet: Wavelet, size: (usize, usize), edge: Edge, normalisation: Normalisation) -> Transform {
    Transform::new(wavelet, size, (edge, edge), normalisation).unwrap()
}

/// A matrix by rows, from what an operator makes of all unit vectors at once, each in its lane.
fn matrix(n: usize, operator: impl Fn(&mut [f32], usize)) -> Vec<Vec<f32>> {
    let mut identity = vec![0.0; n * n];
    (0..n).for_each(|i| identity[i * n + i] = 1.0);
    operator(&mut identity, n);
    identity.chunks(n).map(<[f32]>::to_vec).collect()
}

fn noise(n: usize, seed: u32) -> Vec<f32> {
    let hash = |k: u32| {
        (k ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b).rotate_left(13).wrapping_mul(0xc2b2_ae35)
    };
    (0..n as u32).map(|k| hash(hash(k)) as f32 / u32::MAX as f32 - 0.5).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

fn close(a: &[f32], b: &[f32], tolerance: f32) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

fn after(operator: impl Fn(&mut [f32], usize), data: &[f32], lanes: usize) -> Vec<f32> {
    let mut data = data.to_vec();
    operator(&mut data, lanes);
    data
}

/// `A S = I`, and the adjoints are transposes: each operator as a whole matrix, on every small size.
#[test]
fn operators_of_small_grids_are_inverses_and_transposes() {
    let lines = (1..=17).chain([32, 64]).flat_map(|n| [(n, 1), (1, n)]);
    for size in lines.chain([(2, 2), (3, 3), (4, 2), (5, 8), (6, 4), (16, 4), (8, 16)]) {
        let n = size.0 * size.1;
        for transform in all(size) {
            let analysis = matrix(n, |data, lanes| transform.forward(data, lanes));
            let synthesis = matrix(n, |data, lanes| transform.inverse(data, lanes));
            let analysis_adjoint = matrix(n, |data, lanes| transform.forward_adjoint(data, lanes));
            let synthesis_adjoint = matrix(n, |data, lanes| transform.inverse_adjoint(data, lanes));
            let unit = |i: usize, j: usize| f64::from(u8::from(i == j));
            for i in 0..n {
                let column: Vec<f32> = synthesis.iter().map(|row| row[i]).collect();
                for j in 0..n {
                    let product = dot(&analysis[j], &column);
                    assert!((product - unit(i, j)).abs() < 2e-5, "A S at {j}, {i}: {product}; {transform:?}");
                    let tolerance = 1e-5 * (1.0 + analysis[i][j].abs().max(synthesis[i][j].abs()));
                    assert!((analysis[i][j] - analysis_adjoint[j][i]).abs() < tolerance, "A^T; {transform:?}");
                    assert!((synthesis[i][j] - synthesis_adjoint[j][i]).abs() < tolerance, "S^T; {transform:?}");
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Perfect reconstruction and both adjoint identities, on any size, wavelet, edges and number of lanes.
    #[test]
    fn reconstruction_is_perfect_and_adjoints_are(
        width in 1usize..40, height in 1usize..40, double in 0u32..3, lanes in 1usize..20, pick in 0usize..100, seed: u32,
    ) {
        let size = (width << double, height << double);
        let choices: Vec<Transform> = all(size).collect();
        let transform = &choices[pick % choices.len()];
        let n = size.0 * size.1 * lanes;
        let (x, y) = (noise(n, seed), noise(n, seed.wrapping_add(1)));
        let there = after(|data, lanes| transform.forward(data, lanes), &x, lanes);
        let back = after(|data, lanes| transform.inverse(data, lanes), &there, lanes);
        prop_assert!(close(&back, &x, 1e-5));
        let norm = |v: &[f32]| dot(v, v).sqrt();
        let adjoint = after(|data, lanes| transform.forward_adjoint(data, lanes), &y, lanes);
        prop_assert!((dot(&there, &y) - dot(&x, &adjoint)).abs() < 1e-6 * (norm(&there) * norm(&y) + norm(&x) * norm(&adjoint)));
        let synthesised = after(|data, lanes| transform.inverse(data, lanes), &x, lanes);
        let adjoint = after(|data, lanes| transform.inverse_adjoint(data, lanes), &y, lanes);
        prop_assert!((dot(&synthesised, &y) - dot(&x, &adjoint)).abs() < 1e-6 * (norm(&synthesised) * norm(&y) + norm(&x) * norm(&adjoint)));
    }

    /// Lanes agree with one function at a time, bit for bit.
    #[test]
    fn lanes_do_not_mix(width in 1usize..70, height in 1usize..20, lanes in 2usize..36, pick in 0usize..100) {
        let choices: Vec<Transform> = all((width, height)).collect();
        let transform = &choices[pick % choices.len()];
        let data = noise(width * height * lanes, 5);
        let operators: [Operator<'_>; 4] = [
            &|data, lanes| transform.forward(data, lanes),
            &|data, lanes| transform.inverse(data, lanes),
            &|data, lanes| transform.forward_adjoint(data, lanes),
            &|data, lanes| transform.inverse_adjoint(data, lanes),
        ];
        for operator in operators {
            let together = after(operator, &data, lanes);
            for lane in [0, lanes / 2, lanes - 1] {
                let pick = |data: &[f32]| data.iter().skip(lane).step_by(lanes).copied().collect::<Vec<f32>>();
                prop_assert_eq!(pick(&together), after(operator, &pick(&data), 1));
            }
        }
    }
}

/// Thesis, A.2 and A.3; and columns and rows of two dimensions are the same line.
#[test]
fn the_worked_example_of_the_thesis() {
    for edge in EDGES {
        for size in [(4, 1), (1, 4)] {
            let haar = new(Wavelet::Haar, size, edge, Normalisation::Amplitude);
            assert_eq!(after(|data, lanes| haar.forward(data, lanes), &[8.0, 2.0, 1.0, 5.0], 1), [4.0, 1.0, 3.0, -2.0]);
        }
    }
    let analysis = matrix(4, |data, lanes| {
        new(Wavelet::Haar, (4, 1), Edge::Cyclic, Normalisation::Amplitude).forward(data, lanes);
    });
    let thesis = [[0.25, 0.25, 0.25, 0.25], [0.25, 0.25, -0.25, -0.25], [0.5, -0.5, 0.0, 0.0], [0.0, 0.0, 0.5, -0.5]];
    assert_eq!(analysis, thesis);
}

/// The filters of A.4, read off one level of a long line, to the digits that the thesis prints. Its high-pass filters of
/// the 5/3 and the 9/7 are twice ours (see [`Normalisation::Amplitude`]).
#[test]
fn the_filters_of_the_thesis() {
    // Odd multiples of two: one level.
    let (n, middle) = (34, 8);
    let rows = |wavelet, normalisation| {
        matrix(n, |data, lanes| new(wavelet, (n, 1), Edge::Cyclic, normalisation).forward(data, lanes))
    };
    let check = |row: &[f32], first: usize, filter: &[f32]| {
        let nonzero: Vec<usize> = (0..n).filter(|i| row[*i].abs() > 1e-6).collect();
        assert_eq!(nonzero, (first..first + filter.len()).collect::<Vec<usize>>());
        assert!(close(&row[first..first + filter.len()], filter, 6e-6), "{row:?} against {filter:?}");
    };
    let rows_53 = rows(Wavelet::LeGall53, Normalisation::Amplitude);
    check(&rows_53[middle], 2 * middle - 2, &[-0.125, 0.25, 0.75, 0.25, -0.125]);
    check(&rows_53[n / 2 + middle], 2 * middle, &[-0.25, 0.5, -0.25]);
    let rows_97 = rows(Wavelet::Daubechies97, Normalisation::Amplitude);
    let low = [0.02675, -0.01686, -0.07822, 0.26686, 0.60295, 0.26686, -0.07822, -0.01686, 0.02675];
    check(&rows_97[middle], 2 * middle - 4, &low);
    let high = [0.09127, -0.05754, -0.59127, 1.11509, -0.59127, -0.05754, 0.09127].map(|tap| tap / 2.0);
    check(&rows_97[n / 2 + middle], 2 * middle - 2, &high);
    check(
        &rows(Wavelet::Daubechies4, Normalisation::Energy)[middle],
        2 * middle,
        &[0.48296, 0.83652, 0.22414, -0.12941],
    );
    let d8 = [0.23038, 0.71485, 0.63088, -0.02798, -0.18703, 0.03084, 0.03288, -0.01060];
    check(&rows(Wavelet::Daubechies8, Normalisation::Energy)[middle], 2 * middle, &d8);
}

/// Polynomials below the number of vanishing moments have no details away from the edges; the next power has.
#[test]
fn moments_vanish() {
    let n = 64;
    for wavelet in Wavelet::ALL {
        // One level: 64 = 2 x 32, so look at the finest details.
        let transform = new(*wavelet, (n, 1), Edge::Cyclic, Normalisation::Amplitude);
        for power in 0..=wavelet.vanishing_moments() as i32 {
            let line: Vec<f32> = (0..n).map(|x| ((x as f32 - 32.0) / 32.0).powi(power)).collect();
            let details = &after(|data, lanes| transform.forward(data, lanes), &line, 1)[n / 2 + 5..n - 5];
            let largest = details.iter().fold(0f32, |largest, value| largest.max(value.abs()));
            if power < wavelet.vanishing_moments() as i32 {
                assert!(largest < 1e-6, "{wavelet:?}, x^{power}: {largest}");
            } else {
                assert!(largest > 2e-6, "{wavelet:?}, x^{power}: {largest}");
            }
        }
    }
}

/// Constants keep their value in the constant-amplitude normalisation, whatever the size, and have no details; lengths
/// are kept by orthonormal wavelets in the constant-energy one.
#[test]
fn normalisations_are_what_they_say() {
    for size in [(1, 1), (2, 1), (5, 3), (7, 4), (12, 8), (16, 16)] {
        for transform in all(size) {
            let n = size.0 * size.1;
            let constant = after(|data, lanes| transform.forward(data, lanes), &vec![3.0; n], 1);
            let tree = transform.tree();
            let expected = match transform.normalisation() {
                Normalisation::Amplitude => 3.0,
                Normalisation::Energy => {
                    let axes = [size.0, size.1].iter().filter(|side| **side > 1).count() as u32;
                    3.0 * 2f32.powf(0.5 * (axes * tree.levels()) as f32)
                }
            };
            for location in 0..n as u32 {
                let wanted = if tree.orientation(location).is_none() { expected } else { 0.0 };
                let found = constant[location as usize];
                assert!((found - wanted).abs() < 1e-5 * expected, "{found} for {wanted}; {transform:?}");
            }
            let orthonormal = !matches!(transform.wavelet(), Wavelet::LeGall53 | Wavelet::Daubechies97);
            if size.0 % 4 == 0 && orthonormal && transform.normalisation() == Normalisation::Energy {
                let x = noise(n, 3);
                let c = after(|data, lanes| transform.forward(data, lanes), &x, 1);
                assert!((dot(&x, &x) - dot(&c, &c)).abs() < 1e-6 * dot(&x, &x));
            }
        }
    }
}

#[test]
fn norms_are_those_of_the_columns_of_the_inverse() {
    for size in [(1, 1), (7, 1), (3, 5), (16, 4), (8, 8), (12, 4)] {
        for transform in all(size) {
            let n = size.0 * size.1;
            let rows = matrix(n, |data, lanes| transform.inverse(data, lanes));
            for (location, norm) in transform.synthesis_norms().into_iter().enumerate() {
                let column: Vec<f32> = rows.iter().map(|row| row[location]).collect();
                let length = dot(&column, &column).sqrt() as f32;
                assert!((norm - length).abs() < 1e-5 * length, "{norm} for {length} at {location}; {transform:?}");
            }
        }
    }
}

#[test]
fn what_cannot_be_is_refused_in_a_sentence() {
    for wavelet in [Wavelet::Daubechies4, Wavelet::Daubechies8] {
        for edges in [(Edge::Cyclic, Edge::Mirrored), (Edge::Mirrored, Edge::Cyclic)] {
            let message = Transform::new(wavelet, (8, 8), edges, Normalisation::Energy).unwrap_err().to_string();
            assert!(message.contains("not symmetric") && message.contains("cyclic edges"), "{message}");
        }
    }
    let message =
        Transform::new(Wavelet::Haar, (0, 8), (Edge::Cyclic, Edge::Cyclic), Normalisation::Energy).unwrap_err();
    assert!(message.to_string().contains("0 x 8"), "{message}");
    for wavelet in Wavelet::ALL {
        assert_eq!(wavelet.id().parse::<Wavelet>().unwrap(), *wavelet);
    }
    let message = "db4".parse::<Wavelet>().unwrap_err().to_string();
    assert!(message.contains("`db4`") && message.contains("haar, 5/3, 9/7, d4, d8"), "{message}");
}

/// Coefficients equal those of an independent implementation; the file says how it was made.
#[test]
fn coefficients_equal_those_of_pywavelets() {
    let (width, height) = (16, 8);
    let values: Vec<f32> = (0..128u32).map(|i| ((37 * i + 11 * i * i) % 101) as f32 / 8.0 - 6.0).collect();
    let lines: Vec<&str> = include_str!("pywavelets.txt").lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(lines.len(), 8 * (1 + height));
    for golden in lines.chunks(1 + height) {
        let (id, edge) = golden[0].split_once(' ').unwrap();
        let edge = if edge == "cyclic" { Edge::Cyclic } else { Edge::Mirrored };
        let transform = new(id.parse().unwrap(), (width, height), edge, Normalisation::Energy);
        let theirs: Vec<f32> = golden[1..].iter().flat_map(|row| row.split(' ').map(|v| v.parse().unwrap())).collect();
        let ours = after(|data, lanes| transform.forward(data, lanes), &values, 1);
        assert!(close(&ours, &theirs, 1e-5), "{}: {ours:?} against {theirs:?}", golden[0]);
    }
}
