# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Search for dark ellipses in an image: connected regions below one of several grey levels.

The image of a circle is dark at all levels between its ink and its paper, so its regions at these
levels lie in each other, and the middle one is taken. Whether it is an ellipse is seen from its
moments. The time depends on the number of pixels, and of the regions, which is limited: each level
takes one pass over the image, whatever it holds, where a detector that follows outlines and
compares all pairs of them takes minutes for a fine pattern.

This module stands alone: it is numerics, without boards, and has tests of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from p4pfr_ros.core.geometry import Array, Ints, Mask

# A circle must be darker than its paper by two steps, to be seen at one level for certain.
LEVELS = tuple(range(30, 230, 20))
# Smaller regions have no shape.
_MIN_AREA_PX = 12
_MIN_SIDE_PX = 3
# Area of a region, in areas of its upright bounding box: 0.79 for a circle, less for an ellipse
# that lies askew, more for a few pixels.
_MIN_FILL, _MAX_FILL = 0.3, 0.9
_ANY_FILL_BELOW_PX = 8
# Largest distance between the centroid and the middle of the box: so many pixels, and sides.
_OFF_MIDDLE_PX, _OFF_MIDDLE_IN_SIDES = 0.5, 0.08
# From one level to the next a region grows by blur, at most by this factor and so many pixels.
_MAX_GROWTH, _GROWTH_PX = 2.0, 12
# Only so many regions are examined, and so many ellipses kept. Ratio of areas of which the smaller
# one need not be known.
_MOST_REGIONS, MOST_BLOBS = 3000, 2000
CLEARLY_LARGER = 2.0
# The area of an ellipse with the same second moments is that of the region.
_LEAST_AREA_RATIO, _LARGEST_AREA_RATIO = 0.85, 1.2
_MAX_AXIS_RATIO = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Blobs:
    """
    Dark ellipses in an image, the largest first.

    Parameters
    ----------
    middles : (M, 2) array
        Their centroids, pixels.
    moments : (M, 2, 2) array
        Their second moments about these, px²: a quarter of the squares of the ellipse's radii.
    are_all
        Whether these are all, or smaller ones were too many.

    """

    middles: Array
    moments: Array
    are_all: bool = True

    @property
    def diameters_px(self) -> Array:
        """Diameters (M,) of circles of the same area, pixels."""
        diameters: Array = 4.0 * np.linalg.det(self.moments) ** 0.25
        return diameters


class _Region(NamedTuple):
    """Columns of an array of regions: upright box, area, pixel at the centroid, level."""

    left: int = 0
    top: int = 1
    width: int = 2
    height: int = 3
    area: int = 4
    x: int = 5
    y: int = 6
    level: int = 7


_OF, _COLUMNS = _Region(), 8


def find_blobs(grey: NDArray[np.uint8], max_area_px: float) -> Blobs:
    """
    Find the dark ellipses of at most an area in an image (h, w).

    In an image with too many of them, those that are clearly larger than any that is left out: so
    no pattern of equal ellipses is found in part.
    """
    regions = _middle_regions(grey, max(max_area_px, 2.0 * _MIN_AREA_PX))
    examined = _largest(regions.astype(np.float64), _MOST_REGIONS)
    ellipses = [_ellipse(grey, region) for region in examined.astype(np.int64).tolist()]
    is_ellipse = np.array([each is not None for each in ellipses], dtype=bool)
    found = np.array([each for each in ellipses if each is not None]).reshape(-1, 5)
    kept = _largest(np.column_stack([found, examined[is_ellipse]]), MOST_BLOBS)
    xx, yy, xy = kept[:, 2:5].T
    moments = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)
    are_all = len(examined) == len(regions) and len(kept) == len(found)
    return Blobs(kept[:, :2], moments, are_all)


def _largest(regions: Array, at_most: int) -> Array:
    """Return of regions (N, ...), whose last columns are those of ``_Region``, the largest."""
    area = regions[:, _OF.area - _COLUMNS]
    regions = regions[np.argsort(-area, kind='stable')]
    if len(regions) <= at_most:
        return regions
    area = regions[:, _OF.area - _COLUMNS]
    largest: Array = regions[area > CLEARLY_LARGER * area[at_most]]
    return largest


def _middle_regions(grey: NDArray[np.uint8], max_area_px: float) -> Ints:
    """Return the regions (N, 8), of those that lie in each other the one at the middle level."""
    regions, chains = [], []
    last = np.empty((0, _COLUMNS), dtype=np.int64)  # the last region of each chain
    # Memory that is used again: fresh pages cost more time than the work on them.
    is_dark, labels = np.empty_like(grey), np.empty(grey.shape, dtype=np.int32)
    for level in LEVELS:
        stats, centroids = _components(grey, level, is_dark, labels)
        found, label = _candidates(labels, stats, centroids, max_area_px, level)
        chain = _continued(last, labels, len(stats), found, label)
        is_new = chain < 0
        chain[is_new] = len(last) + np.arange(is_new.sum())
        last = np.concatenate([last, found[is_new]])
        last[chain] = found
        regions.append(found)
        chains.append(chain)
    all_regions, all_chains = np.concatenate(regions), np.concatenate(chains)
    by_chain = np.argsort(all_chains, kind='stable')  # within a chain, by level
    lengths = np.bincount(all_chains)
    middle: Ints = all_regions[by_chain[np.cumsum(lengths) - lengths + lengths // 2]]
    return middle


def _components(
    grey: NDArray[np.uint8], level: int, is_dark: NDArray[np.uint8], labels: NDArray[np.int32]
) -> tuple[Ints, Array]:
    """Write the labels (h, w) of the dark regions; return boxes and areas (n, 5), centroids."""
    cv2.threshold(grey, level, 255, cv2.THRESH_BINARY_INV, dst=is_dark)
    # Regions that touch at the corners of pixels are one: so a fine pattern has few of them.
    # Of OpenCV's algorithms, which agree, this one is the fastest.
    _, _, stats, centroids = cv2.connectedComponentsWithStatsWithAlgorithm(
        is_dark, 8, cv2.CV_32S, cv2.CCL_GRANA, labels=labels
    )
    return np.asarray(stats, dtype=np.int64), np.asarray(centroids)


def _candidates(
    labels: NDArray[np.int32], stats: Ints, centroids: Array, max_area_px: float, level: int
) -> tuple[Ints, Ints]:
    """Return the regions (N, 8) that may be ellipses by their boxes and areas; their labels."""
    left, top, width, height, area = stats.T
    smaller = np.minimum(width, height)
    good = (area >= _MIN_AREA_PX) & (area <= max_area_px) & (smaller >= _MIN_SIDE_PX)
    fill = area / np.maximum(width * height, 1)
    good &= (fill >= _MIN_FILL) & ((fill <= _MAX_FILL) | (smaller < _ANY_FILL_BELOW_PX))
    # A region at the border of the image is cut.
    good &= (left > 0) & (top > 0)
    good &= (left + width < labels.shape[1]) & (top + height < labels.shape[0])
    good[0] = False  # the bright part of the image
    for axis, (low, side) in enumerate(((left, width), (top, height))):
        off_px = np.abs(centroids[:, axis] - (low + 0.5 * (side - 1)))
        good &= off_px <= _OFF_MIDDLE_PX + _OFF_MIDDLE_IN_SIDES * side
    label = np.flatnonzero(good)
    x, y = np.rint(centroids[label]).astype(np.int64).T
    # A ring is bright in its middle.
    is_there = labels[y, x] == label
    label, x, y = label[is_there], x[is_there], y[is_there]
    return np.column_stack([stats[label], x, y, np.full(len(label), level)]), label


def _continued(
    last: Ints, labels: NDArray[np.int32], count: int, found: Ints, label: Ints
) -> Ints:
    """
    Return which chain each region found at a level (N,) continues, or -1.

    last (n, 8): the last regions of the chains, at lower levels; labels (h, w): the regions at
    this level; label (N,): which of them were found.
    """
    index = np.full(count, -1)
    index[label] = np.arange(len(label))
    around = index[labels[last[:, _OF.y], last[:, _OF.x]]]
    within = np.flatnonzero(around >= 0)
    at_most = _MAX_GROWTH * last[within, _OF.area] + _GROWTH_PX
    within = within[found[around[within], _OF.area] <= at_most]
    # Of several chains within one region, the one whose region is largest continues.
    within = within[np.argsort(last[within, _OF.area], kind='stable')]
    chain = np.full(len(found), -1)
    chain[around[within]] = within
    return chain


def _ellipse(grey: NDArray[np.uint8], region: list[int]) -> tuple[float, ...] | None:
    """Return the centroid x, y and second moments xx, yy, xy of a region; None: no ellipse."""
    left, top, width, height, _, x, y, level = region
    dark = (grey[top : top + height, left : left + width] <= level).view(np.uint8)
    labels = cv2.connectedComponents(dark, connectivity=8)[1]
    own: Mask = labels == labels[y - top, x - left]
    moments = cv2.moments(own.view(np.uint8), binaryImage=True)
    area = moments['m00']
    xx, yy, xy = (moments[key] / area for key in ('mu20', 'mu02', 'mu11'))
    # The radii of the ellipse are twice the roots of the eigenvalues.
    mean, half_difference = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    largest, smallest = mean + half_difference, mean - half_difference
    if not largest < _MAX_AXIS_RATIO**2 * smallest:
        return None
    ratio = area / (4.0 * np.pi * np.sqrt(largest * smallest))
    if not _LEAST_AREA_RATIO < ratio < _LARGEST_AREA_RATIO:
        return None
    return left + moments['m10'] / area, top + moments['m01'] / area, xx, yy, xy
