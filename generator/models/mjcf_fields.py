"""The fields of MuJoCo's compiled model, each in one of three classes.

    READ      the model here has it
    INERT     it moves nothing: views, sensors, contacts (refused as a whole), the solver, sizes
    REFUSED   it moves something that no model here has, and is refused unless at its default

A field in none of them, as a later MuJoCo may have, is refused by its name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np

from ...core.arguments import few
from ...core.errors import InputError
from ...core.records import dataclass

__all__ = ["ENABLE_FLAGS", "REFUSED", "Refusal", "check_fields", "count_refused",
           "fields_of", "flags_of"]


def _field_names(groups: Mapping[str, str]) -> frozenset[str]:
    """Return the names of fields, from prefix → rests of the names in one text."""
    return frozenset(prefix + name for prefix, names in groups.items() for name in names.split())


READ = _field_names({
    "": "nactuator nbody neq ngeom ngravcomp njnt nkey nq nsite ntendon nu nv opt qpos0 "
        "qpos_spring",
    "opt.": "disableactuator disableflags enableflags gravity timestep",
    "body_": "gravcomp inertia ipos iquat jntadr jntnum mass mocapid parentid pos quat weldid",
    "jnt_": "actgravcomp axis bodyid dofadr limited pos qposadr range stiffness type",
    "dof_": "armature damping",
    "geom_": "bodyid conaffinity contype group matid pos quat rgba size type",
    "mat_": "rgba",
    "site_": "bodyid pos quat",
    "eq_": "active0 data obj1id obj2id objtype type",
    "tendon_": "adr damping lengthspring num stiffness type",
    "wrap_": "objid prm type",
    "actuator_": "armature biasprm biastype ctrladr ctrllimited ctrlnum damping dampingpoly delay "
                 "dyntype forcelimited gainprm gaintype gear group history outadr outnum plugin "
                 "trnid trntype",
    "key_": "ctrl mpos mquat qpos qvel",
})
INERT = _field_names({
    "": "flg_adhesion flg_gravcomp flg_surfacevel mapD2M mapM2D mapM2M names names_map paths "
        "plugin signature stat vis",
    "n": "B C D Jfe Jmom Jten M a arena buffer bvh bvhdynamic bvhstatic cam conmax efm0L efm0dof "
         "efmCvert emax exclude flexbending flexedge flexelem flexelemdata flexelemedge flexnode "
         "flexshelldata flexstiffness flextexcoord flexvert hfield hfielddata history "
         "jmax light mat mesh meshdegmax meshface meshgraph meshnormal meshpoly meshpolymap "
         "meshpolyvert meshtexcoord meshvert mocap names names_map numeric numericdata oct out "
         "paths plugin pluginattr pluginstate polygonmax sensor sensordata skin skinbone "
         "skinbonevert skinface skintexvert skinvert tex texdata text textdata tree tuple "
         "tupledata userdata wrap",
    "nuser_": "actuator body cam geom jnt sensor site tendon",
    "opt.": "ccd_iterations ccd_tolerance cone impratio integrator iterations jacobian "
            "ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance o_friction "
            "o_margin o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver "
            "tolerance wind",
    "B_": "colind rowadr rownnz", "D_": "colind diag rowadr rownnz", "M_": "colind rowadr rownnz",
    "body_": "bvhadr bvhnum conaffinity contype dofadr dofnum geomadr geomnum invweight0 margin "
             "rootid sameframe simple subtreemass treeid user",
    "bvh_": "aabb child depth nodeid", "oct_": "aabb child coeff depth",
    "jnt_": "actfrcrange actuatorid group margin plasticadr solimp solref user",
    "dof_": "M0 Madr bodyid invweight0 jntid length parentid simplenum solimp solref treeid",
    "tree_": "bodyadr bodynum dofadr dofnum sleep_policy",
    "geom_": "aabb adhesion castshadow condim dataid fluid friction gap margin plugin priority "
             "rbound sameframe solimp solmix solref surfacevel user",
    "site_": "dataid group matid rgba sameframe size type user",
    "cam_": "bodyid fovy intrinsic ipd mat0 mode output pos pos0 poscom0 projection quat "
            "resolution sensorsize targetbodyid user",
    "light_": "active ambient attenuation bodyid bulbradius castshadow cutoff diffuse dir dir0 "
              "exponent intensity mode pos pos0 poscom0 range softness specular targetbodyid texid "
              "type",
    "efm0_": "L L_colind L_rowadr L_rownnz dofid", "efmC_": "perm",
    "flex_": "activelayers bending bendingadr bvhadr bvhnum cellnum centered conaffinity condim "
             "contype damping dim edge edgeadr edgedamping edgeequality edgeflap edgenum "
             "edgestiffness elem elemadr elemdataadr elemedge elemedgeadr elemlayer elemnum "
             "elemtexcoord flatskin friction gap group interp margin matid node node0 nodeadr "
             "nodebodyid nodenum passive plasticadr plasticmode priority radius rgba rigid "
             "selfcollide shell shelldataadr shellnum size solimp solmix solref stiffness "
             "stiffnessadr texcoord texcoordadr vert vert0 vertadr vertbodyid vertcell vertnum "
             "yield",
    "flexedge_": "J_colind J_rowadr J_rownnz invweight0 length0 rigid",
    "mesh_": "bvhadr bvhnum extrema face faceadr facenormal facenum facetexcoord graph graphadr "
             "normal normaladr normalnum octadr octnum pathadr polyadr polymap polymapadr "
             "polymapnum polynormal polynum polyvert polyvertadr polyvertnum pos quat scale "
             "texcoord texcoordadr texcoordnum vert vertadr vertnum",
    "skin_": "boneadr bonebindpos bonebindquat bonebodyid bonenum bonevertadr bonevertid "
             "bonevertnum bonevertweight face faceadr facenum group inflate matid pathadr rgba "
             "texcoord texcoordadr vert vertadr vertnum",
    "hfield_": "adr data ncol nrow pathadr size",
    "tex_": "adr colorspace contenttypeadr data height nchannel pathadr type width",
    "mat_": "emission metallic reflectance roughness shininess specular texid texrepeat texuniform",
    "pair_": "adhesion dim friction gap geom1 geom2 margin signature solimp solref solreffriction",
    "exclude_": "signature", "eq_": "solimp solref",
    "tendon_": "actfrcrange actuatorid group invweight0 length0 margin matid plasticadr range rgba "
               "solimp_fri solimp_lim solref_fri solref_lim treeid treenum user width",
    "ten_": "J_colind J_rowadr J_rownnz",
    "actuator_": "acc0 actadr actearly actlimited actnum actrange cranklength ctrlrange ctrlspec "
                 "dynprm forcerange historyadr length0 lengthrange user",
    "sensor_": "adr cutoff datatype delay dim history historyadr interval intprm needstage noise "
               "objid objtype plugin refid reftype type user",
    "plugin_": "attr attradr stateadr statenum",
    "numeric_": "adr data size", "text_": "adr data size",
    "tuple_": "adr objid objprm objtype size", "key_": "act plastic time",
    "name_": "actuatoradr bodyadr camadr eqadr excludeadr flexadr geomadr hfieldadr jntadr keyadr "
             "lightadr matadr meshadr numericadr pairadr pluginadr sensoradr siteadr skinadr "
             "tendonadr texadr textadr tupleadr",
})


@dataclass(frozen=True)
class Refusal:
    """A field's default, the part of a file that it belongs to, and the flag that switches it off.

    A field with a ``part`` may be ignored by that name; any other one is refused with its
    ``meaning``.
    """

    default: float
    part: str = ""
    off: str = ""
    meaning: str = ""


_SPRING, _DAMPER = "a spring with a polynomial stiffness", "a damper with a polynomial law"
_YIELD = "a spring that yields"
REFUSED = {
    "opt.density": Refusal(0, "fluid"),
    "opt.viscosity": Refusal(0, "fluid"),
    "nflex": Refusal(0, "deformable"),
    "npair": Refusal(0, "contact", off="contact"),
    "dof_frictionloss": Refusal(0, "friction", off="frictionloss"),
    "tendon_frictionloss": Refusal(0, "friction", off="frictionloss"),
    "tendon_limited": Refusal(0, "limits", off="limit"),
    "jnt_actfrclimited": Refusal(0, "limits", off="actuation"),
    "tendon_actfrclimited": Refusal(0, "limits", off="actuation"),
    "tendon_armature": Refusal(0, "tendon"),
    "jnt_stiffnesspoly": Refusal(0, off="spring", meaning=_SPRING),
    "tendon_stiffnesspoly": Refusal(0, off="spring", meaning=_SPRING),
    "dof_dampingpoly": Refusal(0, off="damper", meaning=_DAMPER),
    "tendon_dampingpoly": Refusal(0, off="damper", meaning=_DAMPER),
    "jnt_springyield": Refusal(0, off="spring", meaning=_YIELD),
    "tendon_springyield": Refusal(0, off="spring", meaning=_YIELD),
    "nplastic": Refusal(0, off="spring", meaning=_YIELD),
    "body_plugin": Refusal(-1, meaning="a plugin that acts on a body"),
}
#: Flags of <option> that enable what moves nothing; the others are refused.
ENABLE_FLAGS = frozenset(("override", "energy", "fwdinv", "invdiscrete", "diagexact", "ipc",
                          "speculative"))


def fields_of(model: Any) -> set[str]:
    """Return the names of the fields of a compiled model and of its options."""
    names: set[str] = set()
    for prefix, structure in (("", model), ("opt.", model.opt)):
        names |= {prefix + name for name in dir(structure)
                  if not name.startswith("_") and not callable(getattr(structure, name))}
    return names


def check_fields(fields: Collection[str], version: str) -> None:
    """Refuse a version of MuJoCo whose compiled models have other fields than the known ones."""
    unknown = sorted({*fields} - READ - INERT - REFUSED.keys())
    # a version without one of INERT serves: nothing reads these
    absent = sorted((READ | REFUSED.keys()) - {*fields})
    if unknown or absent:
        raise InputError(
            f"MuJoCo {version} is installed, whose models have {'unknown' if unknown else 'no'} "
            f"fields, {few(unknown or absent)}; install version 4.0 of mujoco-core, or a later "
            "gyrospark.")


def count_refused(model: Any, off: Collection[str]) -> Counter[str]:
    """Return part → number of entries in its fields of ``REFUSED`` that are not at their default.

    ``off`` are the flags that are switched off; their fields do not count. Raises InputError for
    fields that cannot be ignored, and for numbers that are not finite.
    """
    counts: Counter[str] = Counter()
    for name, refusal in REFUSED.items():
        entries = np.asarray(_field(model, name))
        count = int(np.count_nonzero(entries != refusal.default))
        if not count or refusal.off in off:
            continue
        if not refusal.part:
            raise InputError(f"it has {refusal.meaning} ({name} of MuJoCo, {count} of them), which "
                             "no model here has; leave it out.")
        counts[refusal.part] += count
    for name in READ - {"opt"}:
        entries = np.asarray(_field(model, name))
        if entries.dtype.kind == "f" and not np.isfinite(entries).all():
            raise InputError(f"its {name} of MuJoCo is not finite; write smaller numbers.")
    return counts


def _field(model: Any, name: str) -> Any:
    """Return a field of a compiled model, or, if its name begins with "opt.", of its options."""
    return getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name)


def flags_of(bits: int, members: Iterable[tuple[str, int]]) -> set[str]:
    """Return the names of the set bits, from MuJoCo's enumeration; "" stands for unnamed bits."""
    # mjDSBL_CONTACT is called "contact"; members without "_" are counts
    bit_of = {name.partition("_")[2].lower(): int(bit) for name, bit in members if "_" in name}
    flags = {name for name, bit in bit_of.items() if bits & bit}
    return flags | ({""} if bits & ~sum(bit_of.values()) else set())
