//! Rows, spectra, information, bounds and numbers.

use crate::draw::{Draw, Number, all_finite};
use gramian::bound;
use gramian::chi_square;
use gramian::information::Information;
use gramian::posterior::{self, ConstrainedPosterior, Posterior};
use gramian::rows::RowSink;
use gramian::scalar::wrap_angle;
use gramian::spectrum::Spectrum;
use gramian::square_root::SquareRootInformation;

/// Some rows, taken or not.
pub fn information_of<T: Number, const N: usize>(
    draw: &mut Draw<T>,
) -> SquareRootInformation<T, N> {
    let mut root = SquareRootInformation::new();
    for _ in 0..draw.index(N + 3) {
        draw.again();
        let (row, before) = (draw.array(), root);
        let result = root.push(&row);
        draw.unchanged(&result, &root, &before);
        draw.taken(result);
        draw.finite(root.factor().as_flattened());
    }
    draw.again();
    root
}

pub fn square_root_of<T: Number, const N: usize>(draw: &mut Draw<T>) {
    let mut root = information_of::<T, N>(draw);
    let other = information_of::<T, N>(draw);
    let before = root;
    let result = root.merge(&other);
    draw.unchanged(&result, &root, &before);
    let (keep, before) = (draw.positive(), root);
    let result = root.forget(keep);
    draw.unchanged(&result, &root, &before);
    draw.taken(result);
    draw.finite(root.factor().as_flattened());
    answers_of(draw, &root);
    draw.bounds(&[root.determinant(), root.root_determinant()]);
    draw.ordered(&[root.log_determinant()]);
    draw.bounds(&root.crlb_std());
    assert!(
        root.crlb()
            .is_none_or(|crlb| all_finite(crlb.as_flattened()))
    );
    let nullity = (0..N).filter_map(|i| root.null_direction(i)).count();
    assert_eq!(root.rank() + nullity, N, "{}", draw.place());
}

pub fn answers_of<T: Number, const N: usize>(
    draw: &mut Draw<T>,
    root: &SquareRootInformation<T, N>,
) {
    let spectrum = root.spectrum();
    spectrum_of(draw, &spectrum);
    draw.again();
    let rtol = draw.positive();
    if let Some(spectrum) = draw.taken(Spectrum::with_rtol(root, rtol)) {
        spectrum_of(draw, &spectrum);
    }
}

pub fn spectrum_of<T: Number, const N: usize>(draw: &Draw<T>, spectrum: &Spectrum<T, N>) {
    draw.bounds(spectrum.singular_values());
    draw.finite(spectrum.singular_values());
    draw.finite(spectrum.scale());
    draw.finite(spectrum.vectors().as_flattened());
    draw.bounds(&bound::crlb_std(spectrum));
    if let Some(crlb) = bound::crlb(spectrum) {
        draw.finite(crlb.as_flattened());
    }
    for i in 0..N {
        if let Some(null) = spectrum.null_vector(i) {
            draw.finite(&null);
        }
    }
}

pub fn square_root<T: Number>(draw: &mut Draw<T>) {
    match draw.below(4) {
        0 => square_root_of::<T, 1>(draw),
        1 => square_root_of::<T, 2>(draw),
        2 => square_root_of::<T, 3>(draw),
        _ => square_root_of::<T, 4>(draw),
    }
}

pub fn spectrum<T: Number>(draw: &mut Draw<T>) {
    let root = information_of::<T, 3>(draw);
    spectrum_of(draw, &Spectrum::new(&root));
    let rtol: T = gramian::spectrum::default_rtol(draw.index(1 << 40), draw.index(1 << 20));
    draw.finite(&[rtol]);
}

pub fn row_sinks<T: Number>(draw: &mut Draw<T>) {
    let row = draw.array::<3>();
    let mut information = Information::new();
    draw.taken(RowSink::push(&mut information, &row));
    let mut root = SquareRootInformation::new();
    draw.taken(RowSink::push(&mut root, &row));
    #[cfg(feature = "alloc")]
    draw.taken(RowSink::push(&mut Vec::new(), &row));
}

pub fn information<T: Number>(draw: &mut Draw<T>) {
    let mut sum = Information::<T, 4>::new();
    for _ in 0..draw.index(8) {
        draw.again();
        let (row, before) = (draw.array(), sum);
        let result = sum.push(&row);
        draw.unchanged(&result, &sum, &before);
        draw.taken(result);
    }
    draw.again();
    let (index, sigma, before) = (draw.index(6), draw.positive(), sum);
    let result = sum.prior(index, sigma);
    draw.unchanged(&result, &sum, &before);
    draw.taken(result);
    let before = sum;
    let result = sum.add(&before);
    draw.unchanged(&result, &sum, &before);
    draw.finite(sum.matrix().as_slice());
    let keep = [draw.index(5), draw.index(5)];
    let parts = [sum.fix_others(&keep), sum.marginalize_others(&keep)];
    for part in parts.into_iter().flatten() {
        draw.finite(part.matrix().as_slice());
    }
}

pub fn posterior<T: Number>(draw: &mut Draw<T>) {
    let mut bound = Posterior::<T, 3>::unknown();
    for _ in 0..draw.index(5) {
        draw.again();
        let (row, before) = (draw.array(), bound);
        let result = bound.update(&row);
        draw.unchanged(&result, &bound, &before);
        draw.taken(result);
        draw.again();
        let (inverse, noise) = (draw.arrays::<3, 3>(), draw.arrays::<3, 2>());
        let (before, count) = (bound, draw.index(3));
        draw.sound |= count < 2;
        let result = bound.predict(&inverse, &noise[..count]);
        draw.unchanged(&result, &bound, &before);
        if count == 2 {
            draw.taken(result);
        }
        draw.finite(bound.root().factor().as_flattened());
        draw.bounds(&bound.standard_deviations());
    }
}

pub fn constrained_posterior<T: Number>(draw: &mut Draw<T>) {
    let mut bound = ConstrainedPosterior::<T, 3>::unknown();
    for _ in 0..draw.index(6) {
        draw.again();
        let (row, before) = (draw.array(), bound);
        let result = match draw.below(2) {
            0 => bound.update(&row),
            _ => bound.know(&row),
        };
        draw.unchanged(&result, &bound, &before);
        draw.taken(result);
        draw.again();
        let (inverse, noise) = (draw.arrays::<3, 3>(), draw.arrays::<3, 2>());
        let (before, count) = (bound, draw.index(3));
        draw.sound |= count < 2;
        let result = bound.predict(&inverse, &noise[..count]);
        draw.unchanged(&result, &bound, &before);
        if count == 2 {
            draw.taken(result);
        }
        let known = bound.information();
        if let Some(crlb) = known.crlb() {
            draw.finite(crlb.as_flattened());
        }
        draw.bounds(&bound.standard_deviations());
        assert!(known.exact() <= known.rank());
    }
}

pub fn semidefinite_root<T: Number>(draw: &mut Draw<T>) {
    let n = draw.index(4);
    let mut covariance = draw.numbers(n * n);
    if draw.below(2) == 0 {
        for i in 0..n {
            for j in 0..i {
                covariance[i * n + j] = covariance[j * n + i];
            }
            covariance[i * n + i] = covariance[i * n + i].abs() * T::of(3.0);
        }
    }
    let mut out = vec![T::zero(); n * n + draw.index(2)];
    draw.sound = all_finite(&covariance);
    if draw
        .taken(posterior::semidefinite_root(&covariance, n, &mut out))
        .is_some()
    {
        draw.finite(&out);
    }
}

pub fn chi_square<T: Number>(draw: &mut Draw<T>) {
    let (value, dof) = (draw.positive(), draw.positive());
    if let Some(p) = draw.taken(chi_square::survival(value, dof)) {
        assert!(p >= T::zero() && p <= T::one(), "{}: {p}", draw.place());
    }
}

pub fn scalar<T: Number>(draw: &mut Draw<T>) {
    let angle = draw.x();
    if let Some(wrapped) = draw.taken(wrap_angle(angle)) {
        assert!(
            wrapped > -T::pi() && wrapped <= T::pi(),
            "{}: {wrapped}",
            draw.place()
        );
    }
}
