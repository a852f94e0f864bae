# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts: what the search of a pair of bodies finds, as flat arrays.

A contact joins two points that face each other, one on each surface. The unit normal n leads from
the antagonist to the candidate, the gap is g = n . (x_c - x_a), negative where they penetrate, and
both sides act at one common point, midway between x_c and x_a: equal and opposite forces along one
line leave the angular momentum as it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Contacts(NamedTuple):
    """Contacts, sorted by key.

    Attributes:
        body: shape (n, 2), int32: rigid body of the candidate and of the antagonist; -1 for a side
            that is meshed.
        nodes: shape (n, 2, k), int32: mesh nodes of a meshed side; zeros on a rigid side. k is 1 if
            all sides are rigid.
        weights: shape (n, 2, k): their weights; zeros on a rigid side.
        point: shape (n, dim), the common point (m): the middle of the two that face each other.
        normal: shape (n, dim), unit, from antagonist to candidate.
        gap: shape (n,), m; negative where the sides penetrate.
        area: shape (n,), m^2 (2D: m, per metre of depth): the contact's share of the overlap of two
            flat sides; 1 for discs and spheres.
        key: shape (n, 2), int64, unique, sorted lexicographically: what stays while the same
            features touch; the pair in the first column, the feature in the second.
    """

    body: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    key: np.ndarray

    def __len__(self) -> int:
        return self[0].shape[0]

    @property
    def dim(self) -> int:
        """Dimension of space."""
        return self.point.shape[1]

    def take(self, indices: np.ndarray) -> Contacts:
        """The contacts at `indices`, in that order."""
        return Contacts(*(a[indices] for a in self))


def empty(dim: int, k: int = 1) -> Contacts:
    """No contacts, in dimension `dim`, with room for `k` nodes a side."""
    return Contacts(
        np.empty((0, 2), np.int32),
        np.empty((0, 2, k), np.int32),
        np.empty((0, 2, k)),
        np.empty((0, dim)),
        np.empty((0, dim)),
        np.empty(0),
        np.empty(0),
        np.empty((0, 2), np.int64),
    )


def join(parts: list[Contacts]) -> Contacts:
    """Several sets of contacts as one, sorted by key.

    Args:
        parts: at least one, all of one dimension; their numbers of nodes a side may differ (the
            missing ones get the weight zero).

    Raises:
        ValueError: two contacts have the same key.
    """
    k = max(part.nodes.shape[2] for part in parts)
    filled = [part for part in parts if len(part)] or parts[:1]
    joined = Contacts(
        *(
            np.concatenate(widened) if len(widened) > 1 else widened[0]
            for arrays in zip(*(tuple(part) for part in filled), strict=True)
            for widened in [[_widened(a, k) if a.ndim == 3 else a for a in arrays]]
        )
    )
    return in_order(joined)


def in_order(contacts: Contacts) -> Contacts:
    """The contacts sorted by key.

    Raises:
        ValueError: two contacts have the same key.
    """
    first, second = contacts.key.T
    rises = (first[1:] > first[:-1]) | ((first[1:] == first[:-1]) & (second[1:] > second[:-1]))
    if rises.all():
        return contacts
    contacts = contacts.take(np.lexsort((second, first)))
    same = (contacts.key[1:] == contacts.key[:-1]).all(axis=1)
    if same.any():
        at = int(same.argmax())
        one, other = contacts.body[at : at + 2].tolist()
        raise ValueError(
            f"Keys of contacts should be unique: {tuple(contacts.key[at].tolist())} stands for "
            f"two, between bodies {one} and {other}."
        )
    return contacts


def _widened(array: np.ndarray, k: int) -> np.ndarray:
    """The array with zeros behind the last axis up to k."""
    missing = k - array.shape[2]
    return np.pad(array, ((0, 0), (0, 0), (0, missing))) if missing else array


def spin_arms(contacts: Contacts, x: np.ndarray) -> np.ndarray:
    r"""What makes the spin of meshed sides about the normal n of the velocities of their nodes.

    In least squares, omega = sum_j n . (r_j x v_j) / sum_j |n x r_j|^2 = sum_j b_j . v_j, r_j being
    the place of a node from the middle of its side's.

    Args:
        contacts: in 3D.
        x: positions of the mesh nodes, shape (num_nodes, 3), m.

    Returns:
        b, shape (n, 2, k, 3), 1/m; zero on a side that is rigid, or has one node.
    """
    place = x[contacts.nodes]
    arms = np.cross(contacts.normal[:, None, None], place - place.mean(axis=2, keepdims=True))
    arms[(contacts.nodes == contacts.nodes[:, :, :1]).all(axis=2) | (contacts.body >= 0)] = 0.0
    square = np.einsum("pskd,pskd->ps", arms, arms)[..., None, None]
    return np.divide(arms, square, out=arms, where=square > 0.0)
