"""Edges against closed forms, manufactured limbs and rendered muscles."""

import numpy as np
import pytest
from scipy.integrate import quad

from imaging import Camera, Silhouette, Tone, edge, outline
from imaging.camera import amount_of_luma
from imaging.edge import defocused_step, limb_strength, ramp, step
from imaging.ends import on_cylinder
from imaging.outline import find_outline, smooth

NOISY_PX = 0.05  # the same with the noise of ISO 3200, after smoothing
HARSH_PX = 0.12  # a limb as dark as a twelfth of the middle is a step of 4 levels of noise


def normal(x):
    return np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi)


@pytest.mark.parametrize("blur", [0.5, 1.0, 2.7])
@pytest.mark.parametrize("t", [-3.0, -0.4, 0.0, 0.7, 4.0, 60.0])
def test_the_ramp_is_a_blurred_root(t, blur):
    R = 90.0

    def integrand(x):
        return np.sqrt(x) * (1 - x / (4 * R)) * normal((t - x) / blur) / blur

    expected, _ = quad(integrand, 0, max(t, 0) + 9 * blur, limit=200, epsabs=1e-10)
    assert ramp(t, blur, R) == pytest.approx(expected, abs=2e-4)  # in a table of 4001 values


@pytest.mark.parametrize("disk", [0.05, 0.4, edge.LARGEST_DISK])
@pytest.mark.parametrize("t", [-3.1, -0.7, 0.0, 1.3, 4.0])
def test_a_defocused_step_is_a_step_under_a_semicircle(t, disk):
    blur = 1.3
    radius, gaussian = 2 * blur * np.sqrt(disk), blur * np.sqrt(1 - disk)

    def integrand(angle):  # x = r sin(angle) takes the corners off the semicircle
        return 2 / np.pi * np.cos(angle) ** 2 * step(t - radius * np.sin(angle), gaussian)

    expected, _ = quad(integrand, -np.pi / 2, np.pi / 2, epsabs=1e-10)
    # Six nodes for a disk five times as wide as the Gaussian.
    assert defocused_step(t, blur, disk) == pytest.approx(expected, abs=5e-3)
    assert defocused_step(t, blur, 0.0) == pytest.approx(step(t, blur), abs=1e-12)


@pytest.mark.parametrize("blur", [0.6, 1.2, 2.5])
def test_a_manufactured_shift_is_found(blur):
    t = np.arange(-12.0, 13.0)
    shifts = np.array([-1.37, -0.5, 0.0, 0.21, 1.4])

    def shape(x):
        return step(x, blur) + 0.3 * ramp(x, blur, 120.0)

    windows = 7 + 3 * np.stack([shape(t - shift) for shift in shifts])
    found = edge.best_shift(windows, t, shape, 2.0, 0.1)
    np.testing.assert_allclose(found, shifts, atol=2e-3)  # px: a maximum sampled at 0.1 px


def test_the_smoothers_variance_is_that_of_repeats():
    random = np.random.default_rng(0)
    curves = np.array([smooth(y, 41.0) for y in random.normal(size=(1500, 300))])
    ratio = curves.var(axis=0) / outline.variance_of_smooth(300, 41.0)
    assert ratio.mean() == pytest.approx(1, abs=0.03)
    assert np.all(np.abs(ratio - 1) < 0.25)  # 1500 repeats: 4 % each, 300 of them


def test_what_is_left_over_says_what_has_passed():
    """White noise and a slow wave: the scatter left over gives the density of the noise alone."""
    random = np.random.default_rng(6)
    x = np.arange(900.0)
    found = []
    for _ in range(60):
        noisy = 30 * np.sin(x / 250) + 0.3 * random.normal(size=x.size)
        found.append(outline.density_left_over(noisy - smooth(noisy, 45.0), 45.0))
    assert np.mean(found) == pytest.approx(0.3**2, rel=0.1)  # 60 times 20 waves: 3 %


def cylinder(limb, blur, noise, seed=0, radius=70.3, rows=300, disk=0.0):
    """A lit cylinder of known edges: brightness limb + (1 - limb) n_z, blurred, as 8-bit sRGB.

    A disk of defocus, as a line sees it, is a semicircle.
    """
    random = np.random.default_rng(seed)
    middle = 100.2 + 0.01 * np.arange(rows) + 1.5 * np.sin(np.arange(rows) / 80)
    fine = 8
    u = (np.arange(210 * fine) + 0.5) / fine - 0.5
    q = (u - middle[:, None]) / radius
    light = np.where(np.abs(q) < 1, limb + (1 - limb) * np.sqrt(np.clip(1 - q**2, 0, None)), 0)
    kernel = normal(np.arange(-6 * fine, 6 * fine + 1) / fine / blur)
    if disk:
        across = np.arange(-7 * fine, 7 * fine + 1) / fine / disk
        kernel = np.convolve(kernel, np.sqrt(np.clip(1 - across**2, 0, None)))
    light = np.apply_along_axis(np.convolve, 1, light, kernel / kernel.sum(), "same")
    light = 0.01 + 0.45 * light.reshape(rows, 210, fine).mean(axis=2)
    if noise:
        light = random.poisson(light * 1900) / 1900 + random.normal(0, 3 / 1900, light.shape)
    values = np.interp(light, Tone.srgb().table, np.arange(256))
    return np.clip(np.round(values), 0, 255).astype(np.uint8), middle - radius, middle + radius


def table(limb):
    tone = Tone.srgb()
    levels = np.interp([0.01, 0.01 + 0.45], tone.table, np.arange(256))
    cloth, braid = (tone.light(np.full(3, level)) for level in levels)
    return amount_of_luma(tone, cloth, braid)


@pytest.mark.parametrize("limb", [1.0, 0.5, 0.25, 0.08])
@pytest.mark.parametrize("blur", [0.7, 2.0])
def test_a_smooth_cylinder_in_any_light(limb, blur):
    image, left, right = cylinder(limb, blur, noise=True)
    found = find_outline(image, table(limb), np.arange(300), left + 4, right - 5, resolution=83.0)
    box = np.sqrt(blur**2 + 1 / 12)  # a pixel averages over its width
    assert found.edge.blur == pytest.approx(box, rel=0.12)
    for side, true, inward in ((found.left, left, 1), (found.right, right, -1)):
        off = inward * (side.column - true)
        tolerance = (HARSH_PX if limb < 0.1 else NOISY_PX) * max(1, blur)
        assert abs(off.mean()) < tolerance
        assert off.std() < tolerance


@pytest.mark.parametrize("disk", [1.7, 2.4, 3.3, 4.2])
@pytest.mark.parametrize("limb", [1.0, 0.4])
def test_a_lens_out_of_focus_moves_no_edge(disk, limb):
    image, left, right = cylinder(limb, 0.5, noise=True, disk=disk, seed=4)
    found = find_outline(image, table(limb), np.arange(300), left + 3, right - 4, resolution=83.0)
    assert found.edge.blur == pytest.approx(np.sqrt(0.5**2 + disk**2 / 4 + 1 / 12), rel=0.05)
    for side, true, inward in ((found.left, left, 1), (found.right, right, -1)):
        assert abs(np.mean(inward * (side.column - true))) < 0.06  # px; a Gaussian alone: 0.4


def test_black_threads_leave_no_dents():
    image, left, right = cylinder(0.8, 1.0, noise=True)
    for v in (60, 150, 151, 240):
        image[v : v + 14, :60] = np.minimum(image[v : v + 14, :60], 40)
    found = find_outline(image, table(0.8), np.arange(300), left + 2, right - 2, resolution=83.0)
    assert np.abs(found.left.column - left).max() < 0.5


def test_the_rim_of_a_tape_is_seen_whatever_its_radius_rounds_to():
    """One radius in three thousand has a square below that of its own array."""
    camera = Camera(9000.0, 1.5, (550.0, 1300.0))
    body = Silhouette(np.zeros(0), np.zeros(0), x0=0.0, roll=0.0)
    for radius in np.random.default_rng(0).uniform(0.01, 0.03, 4000):
        u, v = on_cylinder(camera, body, np.zeros(1), np.array([-radius, radius]), float(radius))
        assert np.isfinite([u, v]).all()


@pytest.mark.parametrize("kappa", [-0.1, 0.0, 0.07, 2.0])
@pytest.mark.parametrize("radius", [60.0, 300.0])
def test_the_strength_of_a_limb_is_that_of_its_root(kappa, radius):
    t = np.arange(-15, 22.0)
    inward = np.maximum(t, 0)
    light = np.where(t > 0, 1 + kappa * np.sqrt(inward * (1 - inward / (2 * radius))), 0.0)
    assert limb_strength(0.6 * light, t, 1.0, radius) == pytest.approx(kappa, abs=1e-9)


def woven_limb(t, blur, phase, *, depth=0.95, amplitude=0.05, radius=158.0):
    """A limb whose light waves as the azimuth does, first at `depth` px, and less at grazing sight."""
    fine = np.arange(0.01, t[-1] + 20, 0.02)
    fades = np.sqrt(fine / 5).clip(0, 3)
    light = 1 + amplitude * fades * np.cos(np.pi * np.sqrt(fine / depth) + phase)
    spread = normal((t[:, None] - fine) / blur) / blur
    profile = np.trapezoid(spread * light, fine, axis=1)
    kappa = limb_strength(profile, t, blur, radius)
    return edge.edge_profile([profile] * 2, t, blur, radius, (kappa, kappa), disk=0.2)


@pytest.mark.parametrize("blur", [1.0, 1.2])
def test_the_light_of_the_first_thread_says_how_far_the_edge_is_off(blur, monkeypatch):
    t = np.arange(-10.0, 61.0)
    phases = np.arange(0, 2 * np.pi, np.pi / 6)
    told = np.std([woven_limb(t, blur, phase).shifts[0] for phase in phases])
    monkeypatch.setattr("imaging.edge._first_thread", lambda *_: 0.0)
    by_fit = np.std([woven_limb(t, blur, phase).shifts[0] for phase in phases])
    assert told < 0.7 * by_fit
