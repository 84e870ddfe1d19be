"""Methods of a lobe of one's own that return values of the wrong form are refused when a scene is made."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import dmis
from dmis.brdf.diffuse import Lambert
from dmis.brdf.specular import SpecularReflection
from dmis.testing.scenes import box_scene

WRONG: list[tuple[type, str, Any, str]] = [
    (Lambert, "eval", np.float32(0.3), r"eval must be an array of float of shape \(3, N\) or .*; got float32"),
    (Lambert, "pdf", 0.3, r"pdf must be an array of float of shape \(N,\); got float"),
    (Lambert, "pdf", np.ones(4), r"pdf must be of shape \(N,\); got shape \(4,\) for N = 1"),
    (Lambert, "sample", np.ones((4, 3)), r"sample must be of shape \(3, N\); got shape \(4, 3\)"),
    (SpecularReflection, "scatter", (np.ones((3, 4)), 0.9), r"scatter, factors, must be .*; got float"),
]


@pytest.mark.parametrize(("base", "method", "value", "message"), WRONG, ids=[method for _, method, *_ in WRONG])
def test_a_wrong_form_is_refused(base: type, method: str, value: Any, message: str) -> None:
    """Without the check, a number of `eval` ends in a TypeError of the estimator."""
    lobe = type("Mine", (base,), {method: lambda self, *args: value})(0.5)
    with pytest.raises(ValueError, match=rf"^Mine\.{message}"):
        box_scene(dmis.Material((lobe,)))
    assert box_scene(dmis.Material((type("Fine", (base,), {})(0.5),)))
