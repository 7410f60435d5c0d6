"""Observability indices of a set of configurations, as defined in the literature."""

import numpy as np

from calibtool.planning.information import Knowledge
from calibtool.robot.se3 import Array

Places = tuple[np.ndarray | None, np.ndarray | None]
# Smallest eigenvalue of the candidates' information, over the largest, that counts
_OBSERVABLE = 1e-8


def observability_indices(
    knowledge: Knowledge, q: Array, candidates: Array, places: Places = (None, None)
) -> dict[str, float]:
    """O1 … O5 of the configurations q (N, n).

    They are those of the identification matrix of the geometry alone, placements δζ (Eq. 11) with
    what is unknown of the set-up, because only a minimal model has singular values other than zero:
    rows over the noise, columns times the tolerances, in the L directions that all candidates
    (M, n) together determine. σ_1 ≥ … ≥ σ_L, N configurations:

    O1  (σ_1 … σ_L)^(1/L) / √N   Borm and Menq 1991
    O2  σ_L / σ_1                Driels and Pathre 1990
    O3  σ_L                      Nahvi, Hollerbach and Hayward 1994
    O4  σ_L² / σ_1               Nahvi and Hollerbach 1996 (noise amplification)
    O5  1 / Σ 1/σ_i              Sun and Hollerbach 2008

    places: labelled places (N,) and (M,) of an instrument. All grow with the quality of the set,
    and are 0 for one that leaves a direction undetermined.
    """
    directions = _observable(_geometry_rows(knowledge, candidates, places[1]))
    matrix = _geometry_rows(knowledge, q, places[0]) @ directions
    count = directions.shape[1]
    sigma = np.zeros(count)
    values = np.linalg.svd(matrix, compute_uv=False)
    sigma[: len(values)] = values
    if not sigma[0] > 0 or sigma[-1] <= 1e-12 * sigma[0]:
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    return {
        "O1": float(np.exp(np.log(sigma).mean()) / np.sqrt(len(q))),
        "O2": float(sigma[-1] / sigma[0]),
        "O3": float(sigma[-1]),
        "O4": float(sigma[-1] ** 2 / sigma[0]),
        "O5": float(1.0 / (1.0 / sigma).sum()),
    }


def _geometry_rows(knowledge: Knowledge, q: Array, place: np.ndarray | None) -> Array:
    """Rows of the placements and of the unknown set-up, (N r, l)."""
    blocks = knowledge.parameters.blocks
    columns = np.concatenate(
        [np.arange(blocks[b].start, blocks[b].stop) for b in ("placements", "base", "targets")]
    )
    rows = knowledge.rows(q, place)[:, :, columns]
    return rows.reshape(-1, rows.shape[-1])


def _observable(rows: Array) -> Array:
    """Orthonormal directions (l, L) of the columns that the rows determine."""
    values, vectors = np.linalg.eigh(rows.T @ rows)
    return vectors[:, values > _OBSERVABLE * values[-1]]
