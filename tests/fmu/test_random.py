# SPDX-License-Identifier: BSD-2-Clause
"""Random numbers of the sensors: published vectors, quantiles, distribution, and that a draw
depends on nothing but seed, stream, sample and place.

orbit_sensor at the origin with unit noise publishes its draws as they are.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import kstest

from tests.reference import random_numbers as reference

from .driver import ROOT, bits
from .rejections import rejection

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
SOURCE = """
#include "random.h"
void kat(const uint32_t *c, const uint32_t *k, uint32_t *out)
{
    RandomBlock w = philox((RandomBlock){{c[0], c[1], c[2], c[3]}}, k[0], k[1]);
    memcpy(out, w.word, sizeof w.word);
}
double uniform_of(double seed, double stream, double n, unsigned j, int once)
{
    RandomStream r = {seed, stream};
    Draws d = once ? draws_of_run(&r) : draws_of_sample(&r, n);
    return uniform(&d, j);
}
double quantile(double u) { return normal_quantile(u); }
void many(double seed, unsigned count, double *z)
{
    RandomStream r = {seed, 5};
    for (unsigned i = 0; i < count; i++) {
        Draws d = draws_of_sample(&r, i / 8);
        z[i] = normal(&d, i % 8);
    }
}
"""


@pytest.fixture(scope="module")
def header(tmp_path_factory):
    """random.h behind plain functions."""
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("random")
    (folder / "probe.c").write_text(SOURCE)
    core = ROOT / "fmus" / "core"
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
    include = [f"-I{core / name}" for name in ("adapter", "maths", "models", "physics", "ports")]
    library = folder / "probe.so"
    subprocess.run(
        [COMPILER, *flags, *include, folder / "probe.c", "-o", library, "-lm"], check=True
    )
    probe = ctypes.CDLL(str(library))
    probe.uniform_of.restype = probe.quantile.restype = ctypes.c_double
    probe.uniform_of.argtypes = [ctypes.c_double] * 3 + [ctypes.c_uint, ctypes.c_int]
    probe.quantile.argtypes = [ctypes.c_double]
    return probe


ALL = 0xFFFFFFFF
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ALL, ALL, ALL, ALL), (ALL, ALL), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
"""kat_vectors of Random123 (philox4x32 10), Salmon et al. 2011."""


@pytest.mark.parametrize(("counter", "key", "words"), KNOWN_ANSWERS)
def test_philox_gives_the_published_words(header, counter, key, words):
    out = (ctypes.c_uint32 * 4)()
    header.kat((ctypes.c_uint32 * 4)(*counter), (ctypes.c_uint32 * 2)(*key), out)
    assert tuple(out) == words
    assert reference.philox(counter, key) == words


def test_uniform_draws_match_the_words(header):
    """52 bits of two words and half a unit more."""
    expected = [0.4754156201635432, 0.3643608395348209, 0.3880285384035679, 0.6308393584907263]
    assert [header.uniform_of(1, 2, 3, j, 0) for j in range(4)] == expected
    assert reference.uniforms(1, 2, 3, 4).tolist() == expected


@pytest.mark.parametrize("n", [0, 1, 2**32 - 1, 2**32, 3 * 2**32 + 7, 2**40 + 1])
def test_sample_index_runs_beyond_32_bits(header, n):
    ours = [header.uniform_of(7, 2**32 - 1, n, j, 0) for j in range(16)]
    assert ours == reference.uniforms(7, 2**32 - 1, n, 16).tolist()


def test_quantiles(header):
    """Published digits, and scipy's quantile at 1e-15 of the larger of 1 and z."""
    for u, z in [
        (2.0**-53, -8.209536151601386),
        (1e-12, -7.034483825301132),
        (0.0749999, -1.4395321773759004),
        (0.5, 0.0),
    ]:
        assert header.quantile(u) == z
    for u in np.concatenate((np.linspace(1e-4, 0.9999, 997), 10.0 ** -np.arange(1.0, 16))):
        assert header.quantile(u) == pytest.approx(ndtri(u), abs=4e-15, rel=2e-15)


def test_quantile_is_odd_about_one_half(header):
    """1 - u is exact for a uniform draw, and so is the symmetry."""
    for u in (np.random.default_rng(1).integers(0, 2**52, 1000) + 0.5) / 2.0**52:
        assert header.quantile(1 - u) == -header.quantile(u)


def test_draws_never_reach_zero_or_one(header):
    """The largest words give 1 - 2^-53, which is still below 1."""
    top = (2.0**52 - 0.5) / 2.0**52
    assert top < 1
    assert header.quantile(top) == pytest.approx(8.209536151601386, abs=1e-15)


def test_normal_draws_are_normal(header):
    """Kolmogorov-Smirnov with 1e5 draws of a fixed seed; also uncorrelated from place to place."""
    z = np.zeros(100_000)
    header.many.argtypes = [ctypes.c_double, ctypes.c_uint, ctypes.c_void_p]
    header.many(11, len(z), z.ctypes.data)
    assert kstest(z, "norm").pvalue > 0.01
    correlation = np.corrcoef(z.reshape(-1, 8).T) - np.eye(8)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(len(z) / 8)


# ---- through a sensor

UNIT_NOISE = {"sigma_fix_r": 1, "sigma_fix_v": 1, "sample_period": 0.5}


def draws(unit):
    return np.concatenate((unit.get("r_fix_N"), unit.get("v_fix_N")))


def test_sensor_draws_by_seed_stream_and_sample(fmu):
    unit = fmu("orbit_sensor", UNIT_NOISE | {"seed": 1, "stream": 2})
    for n in range(4):
        unit.step(0.5)
        assert draws(unit) == pytest.approx(reference.normals(1, 2, n, 6), rel=4e-15)
    expected = [
        -0.061662956385572364,
        -0.3468264843330489,
        -0.2844610531215538,
        0.33407722834758335,
    ]
    assert draws(unit)[:4].tolist() == expected


def test_draws_of_the_run_have_a_counter_of_their_own(fmu):
    unit = fmu("gyro", {"seed": 1, "stream": 2, "bias_0": [0, 0, 0], "sigma_bias_0": [1, 1, 1]})
    expected = [0.31516892260619184, 0.07046511426207036, -1.433893434320355]
    assert unit.get("bias_S").tolist() == expected


def test_number_of_calls_does_not_matter(fmu):
    """A sensor that comes late or skips calls draws what one that is called often draws."""
    often, seldom = (fmu("orbit_sensor", UNIT_NOISE) for _ in range(2))
    for _ in range(40):
        often.step(0.125)
    seldom.step(5.0)
    late = fmu("orbit_sensor", UNIT_NOISE, start=4.5)
    late.step(0.5)
    assert bits(often) == bits(seldom) == bits(late)


def test_order_of_instances_and_saved_states_do_not_matter(fmu):
    a, b = fmu("orbit_sensor", UNIT_NOISE), fmu("orbit_sensor", UNIT_NOISE)
    a.step(0.5)
    saved = a.slave.getFMUState()
    for unit in (b, a, a, b, b):
        unit.step(0.5)
    assert bits(a) == bits(b)
    a.slave.setFMUState(saved)
    a.slave.freeFMUState(saved)
    a.time = 0.5
    a.step(0.5)
    a.step(0.5)
    assert bits(a) == bits(b)


def test_streams_and_seeds_are_independent(fmu):
    """No draw of one occurs in the other."""
    seen = set()
    for options in ({}, {"stream": 5}, {"seed": 1}, {"seed": 5, "stream": 0}):
        unit = fmu("orbit_sensor", UNIT_NOISE | options)
        for _ in range(10):
            unit.step(0.5)
            seen |= set(draws(unit).tolist())
    assert len(seen) == 4 * 10 * 6


@pytest.mark.parametrize(
    "sensor", ["star_tracker", "gyro", "pose_sensor", "orbit_sensor", "range_sensor"]
)
@pytest.mark.parametrize("value", [0.5, -1, 2.0**32])
@pytest.mark.parametrize("name", ["seed", "stream"])
def test_seed_and_stream_are_whole_numbers_of_32_bits(sensor, name, value, tmp_path):
    assert f"{name} = {value:.9g}: must be" in rejection(sensor, {name: value}, tmp_path / "bad")
    assert not rejection(sensor, {name: 2.0**32 - 1}, tmp_path / "good")


@pytest.mark.parametrize(
    "sensor", ["star_tracker", "gyro", "pose_sensor", "orbit_sensor", "range_sensor"]
)
@pytest.mark.parametrize("period", [0, -0.5])
def test_a_sensor_needs_a_period(sensor, period, tmp_path):
    assert "sample_period" in rejection(sensor, {"sample_period": period}, tmp_path)


def test_every_kind_of_sensor_has_a_stream_of_its_own(fmu):
    """Start values: no two alike, so that a system of one each needs none set."""
    kinds = ("star_tracker", "gyro", "pose_sensor", "orbit_sensor", "range_sensor")
    assert [fmu(kind).get("stream") for kind in kinds] == [1, 2, 3, 4, 5]
