"""NumPy arrays in and out: types, shapes, strides, ownership."""

import gc

import numpy as np
import orbid
import pytest

HENON = orbid.model("henon")


def rhs(x):
    """(1 - a x^2 + y, b x): a map's next iterate."""
    return HENON.rhs(x)


EXPECTED = np.array([[1.0 - 1.4 * 0.25 + 0.1, 0.3 * 0.5], [1.0 - 1.4 + 2.0, 0.3]])
STATES = np.array([[0.5, 0.1], [1.0, 2.0]])


@pytest.mark.parametrize("given", [
    STATES,
    STATES.tolist(),
    np.asfortranarray(STATES),                       # copied: records do not follow each other
    np.repeat(STATES, 2, axis=0)[::2],               # strided
    STATES[::-1][::-1],
    STATES.astype(">f8"),                            # the other order of bytes
    np.frombuffer(b"\0" + STATES.tobytes(), np.uint8)[1:].view(np.float64).reshape(2, 2),  # unaligned
], ids=["float64", "lists", "fortran", "strided", "reversed", "big-endian", "unaligned"])
def test_states_in_any_memory_are_the_same_states(given):
    # Three roundings of numbers near one.
    np.testing.assert_allclose(rhs(given), EXPECTED, rtol=0, atol=1e-15)


def test_read_only_arrays_are_read():
    states = STATES.copy()
    states.setflags(write=False)
    np.testing.assert_allclose(rhs(states), EXPECTED, rtol=0, atol=1e-15)


def test_float32_is_widened_exactly():
    assert np.array_equal(rhs(STATES.astype(np.float32)), rhs(STATES.astype(np.float32).astype(np.float64)))


def test_integers_are_converted_where_float64_holds_them():
    assert np.array_equal(rhs(np.array([[1, 2]])), rhs([[1.0, 2.0]]))
    assert np.array_equal(rhs([1, 2]), rhs([1.0, 2.0]))
    assert np.array_equal(rhs(np.array([2**53, 0])), rhs([2.0**53, 0.0]))
    with pytest.raises(ValueError, match="2\\^53"):
        rhs(np.array([2**53 + 1, 0]))
    with pytest.raises(ValueError, match="2\\^53"):
        rhs(np.array([-(2**53) - 1, 0]))
    with pytest.raises(ValueError, match="2\\^53"):
        rhs(np.array([2**64 - 1, 0], dtype=np.uint64))


@pytest.mark.parametrize("given", [None, "1, 2", [None, 1.0], [True, False], np.array([1 + 1j, 0]),
                                   np.array(["1", "2"]), np.array([1.0, 2.0], dtype=object),
                                   np.ma.array([1.0, 2.0], mask=[0, 1])],
                         ids=["None", "text", "list with None", "bool", "complex", "text array", "object", "masked"])
def test_what_is_no_number_is_a_type_error(given):
    with pytest.raises(TypeError, match="x: .*real numbers are needed"):
        rhs(given)


def test_a_method_named_mask_makes_no_masked_array():
    class Column:
        """As a column of pandas, which has such a method."""

        def mask(self):
            raise AssertionError

        def __array__(self, dtype=None, copy=None):
            return STATES

    assert np.array_equal(rhs(Column()), rhs(STATES))
    written = {"model": {"name": "henon"}, "data": {"file": {"x": np.ma.array([1.0], mask=[1])}}}
    assert "masked" in orbid.check(written)[0].rule


def test_long_double_is_refused():
    if np.dtype(np.longdouble).itemsize <= 8:
        pytest.skip("no wider type here")
    with pytest.raises(TypeError, match="real numbers"):
        rhs(np.array([1.0, 2.0], dtype=np.longdouble))


@pytest.mark.parametrize("given, shape", [([1.0, 2.0, 3.0], r"\(3,\)"), ([[1.0], [2.0]], r"\(2, 1\)"),
                                          (np.zeros((2, 2, 2)), r"\(2, 2, 2\)"), (1.0, r"\(\)")])
def test_wrong_shapes_are_named(given, shape):
    with pytest.raises(ValueError, match=f"x: shape {shape}, needs \\(records, 2\\)"):
        rhs(given)


def test_ragged_lists_are_refused():
    with pytest.raises((ValueError, TypeError)):
        rhs([[1.0, 2.0], [3.0]])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_entries_that_are_not_finite_are_named(bad):
    states = STATES.copy()
    states[1, 0] = bad
    with pytest.raises(ValueError, match=r"x\[1, 0\] = -?(nan|inf): must be a finite number"):
        rhs(states)


def test_no_records_give_no_records():
    assert rhs(np.empty((0, 2))).shape == (0, 2)


def test_results_own_their_memory():
    flow = HENON.flow([0.1, 0.1], np.arange(1000.0))
    states = flow.states
    address = states.__array_interface__["data"][0]
    assert states.flags.c_contiguous and states.flags.writeable and not states.flags.owndata
    kept = states.copy()
    # The same memory each time it is asked for, and after everything else is gone.
    assert flow.states.__array_interface__["data"][0] == address
    row = states[500]
    del flow, states
    gc.collect()
    assert np.array_equal(row, kept[500])


def test_a_million_records_come_out_where_they_were_computed():
    # The array's base is the capsule around the library's matrix: no array stands in between.
    sections = HENON.ensemble([[0.1, 0.1]], 1_000_000).sections
    points = sections[0]
    assert points.shape == (1_000_001, 2)
    assert type(points.base).__name__ == "PyCapsule"
    assert points.flags.c_contiguous
    assert sections[0] is points


def test_arrays_outlive_the_object_they_show():
    orbit = orbid.periodic_orbit(HENON, [0.6, 0.2])
    points = orbit.points
    expected = points.copy()
    assert not points.flags.writeable
    with pytest.raises(ValueError):
        points[0, 0] = 1.0
    del orbit
    gc.collect()
    [orbid.periodic_orbit(HENON, [0.6, 0.2]) for _ in range(10)]
    assert np.array_equal(points, expected)


def test_rows_of_tables_outlive_their_model():
    rows = orbid.equations({"equations": {"x": "-k * x"},
                            "parameters": {"k": {"value": 2.0, "unit": "1/s"}}}).parameters
    gc.collect()
    assert [(row.name, row.unit, row.default) for row in rows] == [("k", "1/s", 2.0)]
