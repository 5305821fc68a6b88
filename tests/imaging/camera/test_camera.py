"""The camera's closed forms against points of the surface projected one by one."""

import numpy as np
import pytest
from rendering import silhouette_from_profile

from imaging import Camera
from imaging.camera import profile_from_silhouette, ring_position

INCH = 0.0254
FULL = Camera(226.63 / INCH, 60 * INCH, (549.5, 1224.5))
NEAR = Camera(300 / INCH, 30 * INCH, (600.0, 1000.0), k1=-0.1)

PROJECTION_PX = 1e-4  # brute force: 4e-4 rad between the points, 1 um between the sections
INVERSION_PX = 1e-4  # cubic interpolation between the rows
CASES = {
    "upright": (FULL, 0.0, 0.0),
    "beside the axis and rolled": (FULL, 3 * INCH, 0.05),
    "rolled the other way": (Camera(43 / INCH, 60 * INCH, (109.5, 249.5)), -0.5 * INCH, -0.05),
    "near, with a barrel lens": (NEAR, 1.0 * INCH, 0.02),
}


def body() -> tuple[np.ndarray, np.ndarray]:
    """A muscle of 9.28 in, 1.0 to 1.9 in thick, its slope up to one."""
    x = np.linspace(0, 1, 4001)
    D = 1.4 - 0.45 * np.cos(2 * np.pi * x) - 0.06 * np.cos(4 * np.pi * x) + 0.1 * (x - 0.5)
    return (x - 0.45) * 9.28 * INCH, D / 2 * INCH


def outermost(camera, y, R, x0, roll, rows, sign):
    """The outermost column of the projected surface at these rows, azimuth by azimuth."""
    best = np.full(rows.shape, -np.inf)
    middle = 0.0 if sign > 0 else np.pi
    for phi in middle + np.linspace(-0.25, 0.25, 1251):
        X, Z = x0 + R * np.cos(phi), camera.distance - R * np.sin(phi)
        turned_x = np.cos(roll) * X - np.sin(roll) * y
        turned_y = np.sin(roll) * X + np.cos(roll) * y
        a, b = turned_x / Z, turned_y / Z
        lens = camera.px_per_m * camera.distance * (1 + camera.k1 * (a**2 + b**2))
        u, v = camera.centre[0] + lens * a, camera.centre[1] + lens * b
        best = np.maximum(best, sign * np.interp(rows, v, u))
    return sign * best


@pytest.mark.parametrize("case", CASES)
def test_outline_is_the_rim_of_the_projected_surface_and_inversion_returns_the_body(case):
    camera, x0, roll = CASES[case]
    y, R = body()
    rows, left, right = silhouette_from_profile(camera, y, R, x0=x0, roll=roll)
    pick = np.linspace(30, rows.size - 31, 25).astype(int)
    for columns, sign in ((left, -1), (right, 1)):
        rim = outermost(camera, y, R, x0, roll, rows[pick], sign)
        np.testing.assert_allclose(columns[pick], rim, atol=PROJECTION_PX)
    found = profile_from_silhouette(camera, rows, left, right)
    error = found.radius - np.interp(found.y, y, R)
    assert np.abs(error).max() * camera.px_per_m < INVERSION_PX
    assert found.x0 == pytest.approx(x0, abs=INVERSION_PX / camera.px_per_m)
    assert found.roll == pytest.approx(roll, abs=INVERSION_PX / np.ptp(rows))


def test_inversion_of_a_noisy_outline_is_not_biased():
    noise_px = 0.05
    y, R = body()
    rows, left, right = silhouette_from_profile(FULL, y, R, x0=1 * INCH, roll=0.03)
    random = np.random.default_rng(5)
    left = left + noise_px * random.standard_normal(rows.size)
    right = right + noise_px * random.standard_normal(rows.size)
    found = profile_from_silhouette(FULL, rows, left, right)
    error = (found.radius - np.interp(found.y, y, R)) * FULL.px_per_m
    # Half the difference of two edges; R' adds a little. The mean has 1/sqrt(n) of it.
    assert 0.6 * noise_px < error.std() < 0.85 * noise_px
    assert abs(error.mean()) < 4 * noise_px / np.sqrt(2 * rows.size)
    # A line through n points spaced evenly over the length fixes its slope to sigma sqrt(12/n)/L.
    slope_stderr = noise_px * np.sqrt(6 / rows.size) / np.ptp(rows)
    assert abs(found.roll - 0.03) < 4 * slope_stderr


def test_ring_is_found_at_every_column():
    radius, y, x0, roll = 0.7 * INCH, 4.6 * INCH, 0.4 * INCH, 0.03
    phi = np.linspace(0.1, np.pi - 0.1, 50)
    X, Z = x0 + radius * np.cos(phi), NEAR.distance - radius * np.sin(phi)
    u, v = NEAR.pixels(np.cos(roll) * X - np.sin(roll) * y, np.sin(roll) * X + np.cos(roll) * y, Z)
    np.testing.assert_allclose(ring_position(NEAR, u, v, radius, x0, roll), y, atol=1e-12)
    assert np.isnan(ring_position(NEAR, u.max() + 5, v[0], radius, x0, roll))
