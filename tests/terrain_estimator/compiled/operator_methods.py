# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: ARG002 (every method takes the same inputs)
"""A module whose methods have every operator with a C++ form."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

KINDS = (torch.bool, torch.int64, torch.float32, torch.float64)


class Pair(NamedTuple):
    """Two tensors."""

    first: Tensor
    second: Tensor


def doubled(
    x: Tensor, times: int = 2, more: Tensor | None = None, less: Tensor | None = None
) -> Tensor:
    if more is not None:
        x = x + more
    return x * times if less is None else x * times - less


class Operators(nn.Module):
    """Methods of x, y [3, 4], v [4], a positive definite m [4, 4] and places k [4]."""

    weight: Tensor
    bias: Tensor
    moves: Tensor
    others: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer(
            "weight", torch.linspace(-1.0, 1.0, 20, dtype=torch.float64).view(5, 4)
        )
        self.register_buffer("bias", torch.linspace(0.0, 1.0, 5, dtype=torch.float64))
        moves = torch.tensor([0.0, 1.0, 0.0, -1.0, 1.0, 0.0, 1.0, 0.0], dtype=torch.float64)
        self.register_buffer("moves", moves.view(8, 1, 1))
        others = torch.tensor([0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0], dtype=torch.float64)
        self.register_buffer("others", others.view(8, 1, 1))
        self.scale, self.count, self.names = 0.1, 3, [2, 1]
        self.limits = (1.5, 2, True)

    @torch.jit.export
    def arithmetic(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        both = [
            x + y,
            x - y,
            x * y,
            x / y,
            x + 2.0,
            x - 2.0,
            x * 0.3,
            x / 3.0,
            torch.rsub(x, 1.0),
            -x,
            2 / x,
        ]
        return torch.stack(both) + v * self.scale

    @torch.jit.export
    def functions(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        p, low = x.abs(), x * 0.1
        return torch.stack(
            [low.sin(), low.cos(), p.sqrt(), p.log(), x.exp(), x.expm1(), x.sin(), x.cos(),
             x.tan(), x.tanh(), x.sign(),
             torch.square(x), torch.reciprocal(x), torch.asin(x), torch.special.erfc(x), x.floor(),
             torch.special.gammainc(p + 0.1, y.abs()), torch.nan_to_num(x, nan=7.0), torch.neg(x)]
        )  # fmt: skip

    @torch.jit.export
    def powers(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        p = x.abs()
        return torch.stack(
            [x**2, x**3, p**0.5, x**-1, x**-2.0, p**-0.5, p**1.7, x**4, p**y, torch.pow(x, y)]
        )

    @torch.jit.export
    def compared(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        return torch.stack(
            [x < y, x <= y, x > y, x >= y, x == y, x != y, x < 0.0, x <= 0.0, x > 0.0, x >= 0.0,
             x == 0.0, x != 0.0, (x > 0.0) & (y > 0.0), (x > 0.0) | (y > 0.0), torch.isnan(x),
             torch.isfinite(x), torch.isinf(x), torch.logical_not(x > 0.0)]
        )  # fmt: skip

    @torch.jit.export
    def chosen(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        return torch.stack(
            [torch.minimum(x, y), torch.maximum(x, y), x.clamp(min=-0.5), x.clamp(-0.5, 0.5),
             x.clamp(max=0.1), torch.where(x > 0.0, x, y), torch.where(x > 0.0, x, 0.0),
             torch.where(x > 0.0, 2.0, y), torch.lerp(x, y, 0.3), torch.lerp(x, y, 0.8),
             torch.addcmul(x, y, v), x % 0.7, x % y, x.clone()]
        )  # fmt: skip

    @torch.jit.export
    def turned(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        ahead = torch.where(x < 0.0, -1.0, 1.0)
        four = torch.stack([x, y]).movedim(0, -1)
        least = max(self.scale, 0.05)
        return torch.cat(
            [torch.hypot(x, y).flatten(), torch.atan2(x, y).flatten(), ahead.to(x.dtype).flatten(),
             four.flatten(), x.clamp(min=least).flatten()]
        )  # fmt: skip

    @torch.jit.export
    def viewed(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        t = x.transpose(0, 1)
        u = x.T
        four = torch.stack([x, y]).permute(2, 0, 1).movedim([0], [2])
        parts = x.split_with_sizes([1, 3], 1)
        a, b, c = y.unbind(0)
        first, second = torch.broadcast_tensors(v, x)  # type: ignore[no-untyped-call]
        flat = [
            t.flatten(), u.flatten(), four.flatten(0, 1).flatten(), parts[0].reshape(-1),
            parts[1].flatten(), a, b, c, first.flatten(), second.flatten(),
            x[1], x[:, 2], x[1:, ::2].flatten(), x.unsqueeze(1).squeeze(1).flatten(),
            x[-1, :2], x.narrow(1, 1, 2).flatten(), x.select(0, -1),
            torch.diagonal(m, 0, 0, 1), torch.diagonal(torch.stack([m, m]), 0, -2, -1).flatten(),
            v.expand(2, -1).flatten(), x.view(4, 3).T.flatten(), x.reshape(2, 6)[:, 1:].flatten(),
            x.unflatten(1, [2, 2])[:, 1].flatten(),  # type: ignore[no-untyped-call]
            v.expand_as(x).flatten(),
        ]  # fmt: skip
        return torch.cat(flat)

    @torch.jit.export
    def made(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        n = x.size(0)
        flat = [
            torch.zeros(n, 2, dtype=torch.float64).flatten(), torch.ones(2, dtype=torch.float64),
            torch.full((n,), 2.5, dtype=torch.float64), torch.full_like(v, 3.0),
            torch.zeros_like(v), torch.ones_like(v), torch.eye(3, dtype=torch.float64).flatten(),
            torch.eye(2, n, dtype=torch.float64).flatten(), torch.arange(n).to(torch.float64),
            torch.arange(1, n + 4).to(torch.float64), torch.arange(1, 9, 3).to(torch.float64),
            torch.tensor(self.scale, dtype=torch.float64).unsqueeze(0),
            nn.functional.pad(x, [1, 0, 0, 2]).flatten(), nn.functional.pad(v, [2, 1], value=1.5),
            x.repeat(2, 1).flatten(), v.repeat(2, 3).flatten(), v.repeat_interleave(2),
            x.repeat_interleave(2, 0).flatten(), torch.diag(v).flatten(), torch.diag(m),
            torch.diag_embed(x).flatten(),
        ]  # fmt: skip
        filled = torch.zeros(2, 3, 4, dtype=torch.float64)
        filled[:, :, :2] = x[:, :2]
        return torch.cat([torch.cat(flat), filled.flatten()])

    @torch.jit.export
    def taken(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        best, place = torch.topk(v, 2)
        return torch.cat(
            [x.index_select(1, k).flatten(), x[:, k].flatten(), x[k[:2].clamp(max=2)].flatten(),
             v[v > 0.0], torch.gather(v, 0, k), best, place.to(torch.float64),
             x[:, v < 100.0].flatten(),
             torch.nonzero(v > 0.0).squeeze(1).to(torch.float64), v[k.view(2, 2)].flatten()]
        )  # fmt: skip

    @torch.jit.export
    def reduced(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        b = x > 0.0
        flat = [
            x.sum(0), x.sum([0, 1], keepdim=True).flatten(), x.sum().unsqueeze(0), x.mean().view(1),
            x.mean(1), x.amax(1), x.amin(0), x.amax().view(1), b.any(0).double(), b.all(1).double(),
            b.any().double().view(1), b.all().double().view(1), b.sum(1).double(),
            v.argmax().double().view(1), torch.softmax(x, 1).flatten(), x.amin().view(1),
            torch.log_softmax(x, -1).flatten(),
            (x * y).sum(0), (x * v).sum([0, 1], keepdim=True).flatten(), (v * y).sum(1),
            (x.T * y.T).sum(0),
            (torch.stack([x, y]) * x).sum([0, 2]), (b * k).sum().double().view(1),
        ]  # fmt: skip
        return torch.cat(flat)

    @torch.jit.export
    def multiplied(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        many = torch.stack([m, 2.0 * m, m + 1.0])
        wide, high = x.repeat(3, 5), y.repeat(5, 5)
        flat = [
            (wide @ high.T).flatten(), (wide[0] @ high.T), (high.T @ high[:, :9]).flatten(),
            (wide @ high[0]), (torch.stack([wide, 2.0 * wide]) @ high.T[:, :5]).flatten(),
            (x @ y.T).flatten(), (x @ v), (v @ m), (x @ many).flatten(), (many @ v).flatten(),
            torch.dot(v, v).view(1), torch.mv(m, v), (many.transpose(1, 2) @ many).flatten(),
            nn.functional.linear(x, self.weight, self.bias).flatten(), (x.T @ y).flatten(),
            nn.functional.linear(v, self.weight).flatten(), (many.unsqueeze(1) @ many).flatten(),
        ]  # fmt: skip
        return torch.cat(flat)

    @torch.jit.export
    def factored(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        many = torch.stack([m, 2.0 * m])
        factor, info = torch.linalg.cholesky_ex(many)
        _, failed = torch.linalg.cholesky_ex(torch.stack([m, -m]))
        right = torch.stack([x.T, y.T])
        large = m.repeat(3, 3) + torch.eye(12, dtype=torch.float64)
        five = torch.stack([large, 2.0 * large, 3.0 * large, 4.0 * large, 5.0 * large])
        beside, fails = torch.linalg.cholesky_ex(torch.cat([five, -five, five[:1]]))
        roots, _ = torch.linalg.cholesky_ex(five)
        flat = [
            fails.double(), beside[:5].flatten(), beside[10].flatten(),
            torch.cholesky_solve(x.repeat(1, 3).T, roots).flatten(),
            torch.cholesky_inverse(roots).flatten(),
            factor.flatten(), info.double(), failed.double(),
            torch.cholesky_solve(right, factor).flatten(), torch.cholesky_inverse(factor).flatten(),
            torch.linalg.solve_triangular(factor, right, upper=False).flatten(),
            torch.cholesky_solve(x.T, factor).flatten(),
        ]  # fmt: skip
        return torch.cat(flat)

    @torch.jit.export
    def kinds(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        b = x > 0.0
        single = x.float()
        flat = [
            (b * x).flatten(), (b * 2).double().flatten(), (b * 0.1).double().flatten(),
            (k / 3).double(), (single * 0.1).double().flatten(),
            (k + 1).double(), (k * 0.1).double(),
            (b.sum() * x).flatten(), (v.to(torch.long) + k).double(), (b & b).double().flatten(),
            torch.zeros(2).double(), (-k).double(), x.to(torch.bool).double().flatten(),
        ]  # fmt: skip
        return torch.cat(flat)

    @torch.jit.export
    def in_loops(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        """Sums and elements, which a fixed form joins."""
        b, wide = x > 0.0, torch.stack([x, y, x - y, x * y, x + 1.0])
        low = (x.abs() * 0.1).clamp(max=0.7)
        each = [
            x.sum(0), x.sum([0, 1], keepdim=True).flatten(), x.sum().unsqueeze(0), x.mean(1),
            wide.mean([0, 2]), wide.sum([1]).flatten(), wide.sum(0).flatten(), x.amax(1), x.amin(0),
            (wide * v).sum([0, 1]), (wide.permute(2, 0, 1) * 2.0).sum(0).flatten(),
            b.any(0).double(), b.all(1).double(), b.any().double().view(1), torch.softmax(v, 0),
            ((x - y) * (x + y) / 3.0).flatten(), (low.sin() + low.cos() * v).flatten(),
            (x.sin() * x.cos()).sum(1), torch.where(b, x.exp(), y.expm1()).flatten(),
            torch.addcmul(x, y, v).sqrt().flatten(), (1.0 - x).abs().log().flatten(),
            (x.abs() ** 1.7 + x**2 + x**3).flatten(), x[:, 1].sin(), x.T.cos().flatten(),
            (wide * (v * v + 1.0).sqrt()).flatten(), ((1.0 / (v * v + 1.0)) ** 0.7 + x).flatten(),
        ]  # fmt: skip
        return torch.cat(each)

    @torch.jit.export
    def in_products(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        """Products and factors, of matrices and of many."""
        many = torch.stack([m, m + torch.diag(v * v), 2.0 * m, m * 1.5, m + m])
        factor, info = torch.linalg.cholesky_ex(many)
        right = torch.stack([x.T, y.T, x.T + y.T, x.T * 2.0, y.T * 0.5])
        one, _ = torch.linalg.cholesky_ex(m)
        whole = torch.stack([x @ m, y @ m])
        each = [
            x @ m, x @ v, v @ m, x @ y.T, whole @ m, whole @ many[:2], m @ right, whole @ v,
            torch.dot(v, v).view(1), torch.mv(m, v), many @ right, right.transpose(1, 2) @ right,
            torch.nn.functional.linear(x, self.weight, self.bias), factor, info.to(v.dtype),
            torch.cholesky_solve(right, factor), torch.cholesky_solve(x.T, one),
            torch.linalg.solve_triangular(factor, right, upper=False),
            torch.cholesky_inverse(factor), torch.cholesky_inverse(one),
        ]  # fmt: skip
        flat = torch.zeros(0, dtype=v.dtype)
        for part in each:
            flat = torch.cat([flat, part.flatten()])
        return flat

    @torch.jit.export
    def in_copies(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        """Parts that are put together."""
        places = torch.cat([torch.arange(1), torch.arange(2, 4)])
        both = torch.stack([x * 2.0, y], 1)
        each = [
            torch.cat([x, y - x], 1), both.permute(2, 0, 1).flatten(1), torch.diag_embed(x),
            nn.functional.pad(x, [1, 0]), nn.functional.pad(x, [0, 2, 1, 0], value=3.0),
            torch.diag(v), x.index_select(1, places), x[:, places], torch.eye(3, dtype=x.dtype),
            torch.zeros_like(x), torch.ones_like(v),
            m.diagonal() + v, x.expand(2, -1, -1).reshape(2, 12), (x > 0.0).to(x.dtype),
        ]  # fmt: skip
        flat = torch.zeros(0, dtype=v.dtype)
        for part in each:
            flat = torch.cat([flat, part.flatten()])
        return flat

    @torch.jit.export
    def in_repeats(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        """Parts with the same numbers, and what is stacked only to be summed."""
        moved = torch.addcmul(x, self.moves, y)
        powers = (moved.abs() + 1.0) ** (self.others + v.abs())
        sine, other = moved.sin(), (x - self.others * v).cos() * y
        both = torch.stack([sine * other, powers * sine])
        longer = torch.cat([sine[1:6], torch.maximum(other[:2], sine[2:4])])
        each = [
            (both * sine).sum(1), (both * moved.exp()).sum(0), both.sum([0, 1]),
            (longer * v).permute(1, 0, 2).flatten(1), sine.permute(2, 0, 1).amax(0), sine[5] + y,
            powers.mean([1, 2]), sine.flatten(0, 1) @ m,
        ]  # fmt: skip
        flat = torch.zeros(0, dtype=v.dtype)
        for part in each:
            flat = torch.cat([flat, part.flatten()])
        return flat

    @torch.jit.export
    def on_two_paths(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        z = x * 2.0
        for _ in range(self.count):
            z = z + v
        if bool((v[:2] > 0.0).any()):
            return z.exp()
        return z - y

    @torch.jit.export
    def flow(self, x: Tensor, y: Tensor, v: Tensor, m: Tensor, k: Tensor) -> Tensor:
        """Branches, loops, lists, dictionaries, tuples and calls."""
        known = {"first": x, "second": y}
        other = known.copy()
        other["first"] = doubled(other["second"], int(k[1]), less=v)
        rows: dict[int, Tensor] = {}
        pieces: list[Tensor] = []
        for place in range(self.count):
            if place in self.names:
                rows[place] = known["first"][place]
                pieces.append(rows[place] * 2.0)
            elif bool(v[0] > 0.0) and place >= 0:
                pieces.append(v)
            else:
                pieces.append(v - 1.0)
        size, jitter = 0, self.limits[0]
        while size < 5 and jitter < 100.0:
            size, jitter = size + 2, jitter * self.limits[1]
        many: list[int] = k.tolist()
        chain = pieces[0]
        for piece in pieces[1:]:
            chain = chain + piece
        if (1 in rows) & (many.count(7) == 0) & (3 not in rows):
            chain = doubled(chain, more=v)
        place = min(many.count(1) + len(pieces) - 2, 3) // 2
        pair = Pair(chain, other["first"][place])
        keys = list(rows.keys())
        dims = x.shape[:1] + x.shape[1:] * 2
        if size * 2 > 3 and size <= 9 and size != 2 and jitter - 1.0 < jitter + 1.0:
            size += x.size(1) - 1
        numbers = torch.tensor(
            jitter * (size - len(dims))
            - jitter
            + (-self.scale)
            + self.scale**2
            + keys[0] / 3.0 * 1.5 / jitter,
            dtype=x.dtype,
        )
        if "second" in known and self.limits[2] and not bool(torch.isnan(v).any()):
            numbers = numbers + x.dim()
        return torch.cat([pair.first, pair.second, numbers.unsqueeze(0)])
