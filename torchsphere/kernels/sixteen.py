"""The sixteen coefficients around a place on the map at once, in four or sixteen lanes of the processor.

The compiler by itself takes one coefficient after the other, which is more than twice as long. What is written here is
its intermediate code (LLVM), which has vectors on every processor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from torchsphere.kernels.jit import FAST_MATH, compiled, in_code

Array = NDArray[Any]

#: Coefficients of the four B-splines of a cell as polynomials, from the cube on, and those of their slopes.
_SPLINES = np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6
_SLOPES = _SPLINES[:3] * [[3], [2], [1]]

_ROW = range(4)

#: Numbers that are worked on at once.
LANES = 16


@compiled
def sum_sixteen(coefficients: Array, at: Any, width: Any, u: Any, v: Any) -> Any:
    """Value of the map from the sixteen coefficients from number ``at`` on, in a cell at ``u`` along and ``v`` across.

    Rows of coefficients are ``width`` apart.
    """
    return _sum_with_slopes(coefficients, at, width, u, v)[0]


@compiled
def sum_with_slopes(coefficients: Array, at: Any, width: Any, u: Any, v: Any) -> Any:
    """`sum_sixteen`, and its derivatives along and across the rows."""
    return _sum_with_slopes(coefficients, at, width, u, v)


@compiled
def add_sixteen(value: Any, at: Any, width: Any, u: Any, v: Any, fours: Array) -> None:
    """Add ``value`` to the sixteen coefficients from number ``at`` on: the adjoint of `sum_sixteen`.

    Number k of the ``fours`` (m, 4) are sums for the coefficients k to k + 3 in rows that begin there: sums that
    overlap in part wait for each other.
    """
    _add_sixteen(value, at, width, u, v, fours)


@compiled
def join_fours(fours: Array, total: Array) -> None:
    """Add the ``fours`` (m, 4) of `add_sixteen` to the coefficients (m,)."""
    for first in range(len(total) - 3):
        for along in range(4):
            total[first + along] += fours[first, along]


@compiled
def add_multiple(share: Any, values: Array, at: Any, total: Array, place: Any) -> None:
    """Add a ``share`` of `LANES` of the ``values``, from number ``at`` on, to the ``total`` from a ``place`` on."""
    _add_multiple(share, values, at, total, place)


@in_code
def _sum_with_slopes(_: Any, coefficients: Any, at: Any, width: Any, u: Any, v: Any) -> tuple[Any, Callable[..., Any]]:
    kind = coefficients.dtype

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, given: Sequence[Any]) -> Any:
        lanes = _Lanes(context, builder, kind)
        first = lanes.address(signature.args[0], given[0], given[1])
        of_u, of_v = lanes.polynomials(given[3], _SPLINES), lanes.polynomials(given[4], _SPLINES)
        by_u, by_v = lanes.polynomials(given[3], _SLOPES), lanes.polynomials(given[4], _SLOPES)
        rows = [lanes.load(builder.gep(first, [builder.mul(given[2], given[2].type(k))]), 4) for k in _ROW]
        value = lanes.sum_of_products(rows, [lanes.spread(of_v, [k] * 4) for k in _ROW])
        across = lanes.sum_of_products(rows, [lanes.spread(by_v, [k] * 4) for k in _ROW])
        pairs = (value, of_u), (value, by_u), (across, of_u)
        found = [lanes.total(lanes.product(*pair)) for pair in pairs]
        return context.make_tuple(builder, signature.return_type, found)

    three = types.UniTuple(kind, 3)  # type: ignore[no-untyped-call]
    return three(coefficients, at, width, u, v), generate


@in_code
def _add_sixteen(_: Any, value: Any, at: Any, width: Any, u: Any, v: Any, fours: Any) -> tuple[Any, Callable[..., Any]]:
    def generate(context: Any, builder: ir.IRBuilder, signature: Any, given: Sequence[Any]) -> Any:
        lanes = _Lanes(context, builder, fours.dtype)
        along = lanes.product(lanes.polynomials(given[3], _SPLINES), lanes.repeated(given[0]))
        across = lanes.polynomials(given[4], _SPLINES)
        for k in _ROW:
            first = builder.add(given[1], builder.mul(given[2], given[2].type(k)))
            four = lanes.address(signature.args[5], given[5], builder.mul(first, first.type(4)))
            added = lanes.product(along, lanes.spread(across, [k] * 4))
            lanes.store(lanes.sum(lanes.load(four, 4), added), four)
        return context.get_dummy_value()

    return types.none(value, at, width, u, v, fours), generate


@in_code
def _add_multiple(_: Any, share: Any, values: Any, at: Any, total: Any, place: Any) -> tuple[Any, Callable[..., Any]]:
    def generate(context: Any, builder: ir.IRBuilder, signature: Any, given: Sequence[Any]) -> Any:
        lanes = _Lanes(context, builder, values.dtype)
        address = lanes.address(signature.args[3], given[3], given[4])
        added = lanes.load(lanes.address(signature.args[1], given[1], given[2]), LANES)
        shares = lanes.spread(lanes.repeated(given[0]), [0] * LANES)
        lanes.store(lanes.sum(lanes.load(address, LANES), lanes.product(added, shares)), address)
        return context.get_dummy_value()

    return types.none(share, values, at, total, place), generate


class _Lanes:
    """Vectors of numbers of a ``kind``, and what a ``builder`` of intermediate code does with them."""

    def __init__(self, context: Any, builder: ir.IRBuilder, kind: Any) -> None:
        self.context, self.builder = context, builder
        self.number, self.bytes = context.get_value_type(kind), kind.bitwidth // 8
        self.flags = tuple(sorted(FAST_MATH))

    def constant(self, values: Sequence[float]) -> Any:
        return ir.Constant(ir.VectorType(self.number, len(values)), [self.number(float(value)) for value in values])

    def spread(self, vector: Any, order: Sequence[int]) -> Any:
        """The numbers of a ``vector`` in that ``order``."""
        places = ir.Constant(ir.VectorType(ir.IntType(32), len(order)), [ir.IntType(32)(k) for k in order])
        return self.builder.shuffle_vector(vector, vector.type(ir.Undefined), places)

    def repeated(self, value: Any) -> Any:
        """Four times the ``value``."""
        none = ir.VectorType(self.number, 4)(ir.Undefined)
        return self.spread(self.builder.insert_element(none, value, ir.IntType(32)(0)), [0] * 4)

    def sum(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=self.flags)

    def product(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=self.flags)

    def sum_of_products(self, a: Sequence[Any], b: Sequence[Any]) -> Any:
        found = self.product(a[0], b[0])
        for one, other in zip(a[1:], b[1:], strict=True):
            found = self.sum(self.product(one, other), found)
        return found

    def total(self, vector: Any) -> Any:
        """Sum of the four numbers of a ``vector``."""
        pairs = self.sum(vector, self.spread(vector, [2, 3, 0, 1]))
        return self.builder.extract_element(self.sum(pairs, self.spread(pairs, [1, 0, 3, 2])), ir.IntType(32)(0))

    def polynomials(self, at: Any, coefficients: Array) -> Any:
        """Values of four polynomials with ``coefficients`` (k, 4)."""
        found, places = self.constant(coefficients[0]), self.repeated(at)
        for row in coefficients[1:]:
            found = self.sum(self.product(found, places), self.constant(row))
        return found

    def address(self, array_type: Any, array: Any, at: Any) -> Any:
        """Of number ``at`` in an ``array`` without gaps."""
        return self.builder.gep(self.context.make_array(array_type)(self.context, self.builder, array).data, [at])

    def load(self, address: Any, count: int) -> Any:
        place = self.builder.bitcast(address, ir.VectorType(self.number, count).as_pointer())
        return self.builder.load(place, align=self.bytes)

    def store(self, vector: Any, address: Any) -> None:
        self.builder.store(vector, self.builder.bitcast(address, vector.type.as_pointer()), align=self.bytes)
