"""The lobes of dmis as a BSDF of Mitsuba 3, so that both renderers have the same integrand.

Mitsuba has no Blinn microfacets, no Fresnel blend, and multiplies the two masking terms of GGX where dmis correlates
them. Here the formulas are written once more, with Mitsuba's own Fresnel terms and GGX distribution. Directions are
accepted as in pbrt: ``wo`` and ``wi`` must be on the same side of the *geometric* normal, and cosines count without
their sign. (Mitsuba's BSDFs go by the shading normal alone; the two differ where a smooth surface turns away.)

Traced by Dr.Jit, this is compiled like Mitsuba's own BSDFs. The parameters of a lobe are kept where a kernel reads
them, so that materials of the same kind share their machine code. Select a variant before this is imported.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from dmis.brdf.ashikhmin_shirley import BlendBase, BlendCoat
from dmis.brdf.distributions import Blinn, Isotropic
from dmis.brdf.fresnel import Conductor, Dielectric, ExactConductor
from dmis.brdf.lobe import Lambert
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import GGX, Microfacet
from dmis.brdf.texture import Image


class Lobes(mi.BSDF):  # type: ignore[misc]
    """The sum of a material's lobes, sampled by picking one of them uniformly; Mitsuba calls the viewer's side wi."""

    def __init__(self, material: Material) -> None:
        mi.BSDF.__init__(self, mi.Properties())
        self.lobes = [_translate(lobe) for lobe in material.lobes]
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        self.m_components = [flags]
        self.m_flags = flags

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        """BRDF times cosine, and density, of the direction `wo`."""
        side = dr.copysign(1, mi.Frame3f.cos_theta(si.wi))
        v, l = si.wi * side, wo * side  # now the shading normal is on the viewer's side
        facing = dr.dot(si.n, si.to_world(si.wi)) * dr.dot(si.n, si.to_world(wo)) > 0
        value, pdf = mi.Color3f(0), mi.Float(0)
        for lobe in self.lobes:
            f, p = lobe.eval_pdf(si, v, l)
            value, pdf = value + f, pdf + p
        above = mi.Frame3f.cos_theta(l) > 0
        value *= dr.abs(mi.Frame3f.cos_theta(l))
        return value & (active & facing), (pdf / len(self.lobes)) & (active & facing & above)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """BRDF times cosine."""
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """Density of `sample`."""
        return self.eval_pdf(ctx, si, wo, active)[1]

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
        """A direction, and BRDF times cosine over density."""
        side = dr.copysign(1, mi.Frame3f.cos_theta(si.wi))
        v = si.wi * side
        wo = self.lobes[0].sample(v, sample2)
        for k, lobe in enumerate(self.lobes[1:], 1):
            wo = dr.select(sample1 * len(self.lobes) >= k, lobe.sample(v, sample2), wo)
        found = mi.BSDFSample3f(wo * side)
        found.eta = 1.0
        found.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        found.sampled_component = mi.UInt32(0)
        value, found.pdf = self.eval_pdf(ctx, si, found.wo, active)
        valid = found.pdf > 0
        return found, dr.select(valid, value / dr.select(valid, found.pdf, 1), 0)

    def to_string(self) -> str:
        """For Mitsuba's own messages."""
        return f"Lobes[{', '.join(type(lobe).__name__ for lobe in self.lobes)}]"


class _Diffuse:
    """Lambert's lobe, or the base of the Fresnel blend if there is a coat of reflectance `specular`."""

    def __init__(self, reflectance: Any, specular: Any = None) -> None:
        self.reflectance = colour(reflectance)
        self.specular = None if specular is None else colour(specular)

    def eval_pdf(self, si: Any, v: Any, l: Any) -> tuple[Any, Any]:
        cos_v, cos_l = mi.Frame3f.cos_theta(v), mi.Frame3f.cos_theta(l)
        value = self.reflectance(si) / dr.pi
        if self.specular is not None:
            through = (1 - (1 - cos_v / 2) ** 5) * (1 - (1 - dr.abs(cos_l) / 2) ** 5)
            value *= (1 - self.specular(si)) * (28 / 23 * through)
        return value, dr.maximum(cos_l, 0) / dr.pi

    def sample(self, v: Any, u: Any) -> Any:
        return mi.warp.square_to_cosine_hemisphere(u)


class _Facets:
    """Blinn's facets, as of Torrance and Sparrow, or as the coat of the Fresnel blend if `blend`."""

    def __init__(self, reflectance: Any, exponent: float, fresnel: Any, blend: bool = False) -> None:
        self.reflectance, self.exponent = colour(reflectance), _number(exponent)
        self.fresnel, self.blend = _fresnel(fresnel), blend

    def eval_pdf(self, si: Any, v: Any, l: Any) -> tuple[Any, Any]:
        cos_v, cos_l = mi.Frame3f.cos_theta(v), dr.abs(mi.Frame3f.cos_theta(l))
        h = dr.normalize(v + l)
        cos_h, cos_d = dr.minimum(dr.abs(mi.Frame3f.cos_theta(h)), 1), dr.dot(v, h)
        lobe = cos_h**self.exponent / (2 * dr.pi)
        pdf = lobe * (self.exponent + 1) / (4 * cos_d)
        value = self.reflectance(si)
        if self.blend:
            value = value + (1 - value) * (1 - cos_d) ** 5
            scale = 1 / (4 * cos_d * dr.maximum(cos_v, cos_l))
        else:
            shadowing = dr.minimum(1, 2 * cos_h * dr.minimum(cos_v, cos_l) / cos_d)
            scale = shadowing / (4 * cos_v * cos_l)
        return value * self.fresnel(cos_d) * (lobe * (self.exponent + 2) * scale), pdf

    def sample(self, v: Any, u: Any) -> Any:
        cos = u.x ** (1 / (self.exponent + 1))
        sin, phi = dr.safe_sqrt(1 - cos * cos), 2 * dr.pi * u.y
        h = mi.Vector3f(sin * dr.cos(phi), sin * dr.sin(phi), cos)
        return h * (2 * dr.dot(v, h)) - v


class _Ggx:
    """GGX with visible facets and masking correlated in height, by way of Mitsuba's distribution."""

    def __init__(self, reflectance: Any, alpha: float, fresnel: Any) -> None:
        self.reflectance, self.fresnel = colour(reflectance), _fresnel(fresnel)
        self.distribution = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, float(alpha), True)

    def eval_pdf(self, si: Any, v: Any, l: Any) -> tuple[Any, Any]:
        cos_v, cos_l = mi.Frame3f.cos_theta(v), mi.Frame3f.cos_theta(l)
        h = dr.normalize(v + l)
        density, cos_d = self.distribution.eval(h), dr.dot(v, h)
        g_v, g_l = self.distribution.smith_g1(v, h), self.distribution.smith_g1(l, h)
        above = (cos_l > 0) & (g_v > 0) & (g_l > 0)
        masking = dr.select(above, 1 / (1 / g_v + 1 / g_l - 1), 0)
        value = self.reflectance(si) * self.fresnel(cos_d) * (density * masking / (4 * cos_v * dr.abs(cos_l)))
        return value & above, (self.distribution.pdf(v, h) / (4 * cos_d)) & above

    def sample(self, v: Any, u: Any) -> Any:
        h, _ = self.distribution.sample(v, u)
        return h * (2 * dr.dot(v, h)) - v


def _translate(lobe: Any) -> Any:
    match lobe:
        case Lambert():
            return _Diffuse(lobe.reflectance)
        case BlendBase():
            return _Diffuse(lobe.diffuse, lobe.specular)
        case Microfacet(distribution=Blinn(exponent=float(exponent))):
            return _Facets(lobe.reflectance, exponent, lobe.fresnel)
        case BlendCoat(distribution=Blinn(exponent=float(exponent))):
            return _Facets(lobe.specular, exponent, None, blend=True)
        case GGX(roughness=Isotropic(alpha=float(alpha))):
            return _Ggx(lobe.reflectance, alpha, lobe.fresnel)
    raise ValueError(f"a lobe must have a counterpart for Mitsuba, or nothing could be compared; got {lobe}")


def colour(value: Any) -> Any:
    """A function of a surface interaction: a constant, or a texture."""
    if isinstance(value, Image):
        image = texture(value)
        return image.eval
    constant = mi.Color3f(*(_number(x) for x in np.broadcast_to(np.asarray(value, float).reshape(-1), 3)))
    return lambda si: constant


def texture(image: Image) -> Any:
    """An image of dmis as a texture of Mitsuba."""
    texels = np.array(np.broadcast_to(image.texels, (*image.texels.shape[:2], 3)), np.float32, order="C")
    if image.wrap == "black":
        raise ValueError("an image's wrap must be 'repeat' or 'clamp', because Mitsuba has no black border")
    matrix = np.diag([*image.scale, 1.0, 1.0])
    matrix[:2, 3] = image.offset
    return mi.load_dict(
        {
            "type": "bitmap",
            "bitmap": mi.Bitmap(texels),
            "raw": True,
            "wrap_mode": image.wrap,
            "to_uv": mi.ScalarTransform4f(matrix),
        }
    )


def _fresnel(fresnel: Any) -> Any:
    if fresnel is None:
        return lambda cos: mi.Float(1)
    if isinstance(fresnel, Dielectric):
        eta = _number(fresnel.eta)
        return lambda cos: mi.fresnel(cos, eta)[0]
    assert isinstance(fresnel, Conductor)
    eta, k = (mi.Color3f(*(_number(x) for x in v)) for v in (fresnel.eta, fresnel.k))
    if isinstance(fresnel, ExactConductor):
        indices = [mi.Complex2f(eta[c], k[c]) for c in range(3)]
        return lambda cos: mi.Color3f(*(mi.fresnel_conductor(cos, index) for index in indices))

    def approximate(cos: Any) -> Any:
        both = (eta * eta + k * k) * cos * cos
        parallel = (both - 2 * eta * cos + 1) / (both + 2 * eta * cos + 1)
        sum2 = eta * eta + k * k + cos * cos
        return (parallel + (sum2 - 2 * eta * cos) / (sum2 + 2 * eta * cos)) / 2

    return approximate


def _number(value: float) -> Any:
    """A number that is data of a kernel, not part of its code."""
    return dr.opaque(mi.Float, float(value))
