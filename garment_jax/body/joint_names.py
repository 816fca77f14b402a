"""What joints are by their names: one reading for bodies and motion files, whoever named them.

Known are Mixamo, MotionBuilder and LaFAN1, both sets of CMU, Bandai-Namco, Rokoko, 100STYLE, Unreal's
mannequin, SMPL, VRM, Rigify and Biped. A part that two skeletons call by one word ("shoulder" is a collar
bone here and an upper arm there) goes to the first role below that has no clearer name.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

SIDES = ("Left", "Right")
# role of a side -> what it is called, clearest first; in the order in which they choose
_SIDED = {
    "UpLeg": ("upleg", "thigh", "upperleg", "hip"),
    "Leg": ("leg", "shin", "calf", "lowerleg", "knee"),
    "Foot": ("ankle", "foot"),
    "ToeBase": ("toebase", "toe", "toes", "ball", "toe0", "foot"),
    "Arm": ("arm", "upperarm", "shldr", "shoulder"),
    "ForeArm": ("forearm", "lowerarm", "elbow"),
    "Hand": ("wrist", "hand"),
    "Shoulder": ("collar", "clavicle", "collarbone", "shoulder"),
}
_MIDDLE = {
    "Hips": ("hips", "pelvis", "hip", "spinebase"),
    "Neck": ("neck", "neck01", "neck1", "necktwist01"),
    "Head": ("head",),
}
_WORDS = {word for words in _SIDED.values() for word in words}
_RIGIFY = {"spine": "hips", "spine.004": "neck", "spine.006": "head"}  # where there is a spine.001
_PREFIX = re.compile(
    r"^(mixamorig\d*|character\d*|armature\d*|valvebiped|bip\d+|bip|j_bip|def|org|rig|cc_base|root)[ _:.|-]+"
    r"(?=.)",
    re.IGNORECASE,
)
_CLOSED_PREFIX = re.compile(r"^mixamorig\d*(?=[A-Z])")  # three.js leaves out the colon
_NUMBER = re.compile(r"[ _]\d+$")
_NUMBERED = 0.8  # part of the names with a number of its own by which these are the file's and no name's
_SIDE = (  # where a name says its side; the group is the letter
    re.compile(r"^(l|r)(?:eft|ight)(?=[^a-z]|[a-z]{3})[ _.-]?", re.IGNORECASE),
    re.compile(r"[ _.-]?(l|r)(?:eft|ight)$", re.IGNORECASE),
    re.compile(r"[ _.-](l|r)(?=[ _.-]|$)", re.IGNORECASE),
    re.compile(r"^(l|r)[ _.-]", re.IGNORECASE),
    re.compile(r"^(l|r)(?=[A-Z])"),
    re.compile(r"^(L|R)(?=[A-Z][a-z])"),
)
NEEDED = ("Hips", *(f"{s}{n}" for s in SIDES for n in ("Arm", "ForeArm", "UpLeg", "Leg", "Foot")))


def plain_name(name: str) -> str:
    """Return a joint's name without namespaces and prefixes, and the numbers that Blender appends."""
    name = re.split(r"[:|]", name)[-1].strip()
    while (shorter := _PREFIX.sub("", name)) != name:
        name = shorter
    name = _CLOSED_PREFIX.sub("", name)
    return re.sub(r"^[Cc]_", "", re.sub(r"\.\d{3}$", "", name))


def without_numbers(names: Sequence[str]) -> list[str]:
    """Return names without the numbers that some exporters give to all joints of a file ("LeftArm_09")."""
    found = [match[0] for name in names if (match := _NUMBER.search(name))]
    if len(found) < _NUMBERED * len(names) or len(set(found)) < len(found):
        return list(names)
    return [_NUMBER.sub("", name) for name in names]


def _key(name: str) -> tuple[str, str]:
    """Return a joint's side ("Left", "Right" or "") and what it is called there, in small letters."""
    name = plain_name(name)
    for pattern in _SIDE:
        found = pattern.search(name)
        if found is not None:
            rest = name[: found.start()] + name[found.end() :]
            side = "Left" if found[1].lower() == "l" else "Right"
            return side, re.sub(r"[^a-z0-9]", "", rest.lower())
    plain = re.sub(r"[^a-z0-9]", "", name.lower())
    if plain[:1] in ("l", "r") and plain[1:] in _WORDS:  # LSHIN
        return "Left" if plain[0] == "l" else "Right", plain[1:]
    return "", plain


def side_pairs(names: Sequence[str]) -> list[tuple[int, int]]:
    """Return the (left, right) joints of the same name but for the side, however that is written."""
    joints = {key: k for k, key in reversed(list(enumerate(map(_key, names))))}
    return [
        (k, joints["Right", rest])
        for (side, rest), k in joints.items()
        if side == "Left" and ("Right", rest) in joints
    ]


def roles_of(names: Sequence[str], parents: np.ndarray) -> dict[str, int]:
    """Return role -> joint for a skeleton: "Hips", "Neck", "Head", "LeftUpLeg" ..., as far as they are told.

    Without a neck the head stands for it.
    """
    names = without_numbers(names)
    keys = [_key(name) for name in names]
    if any(re.split(r"[:|-]", name)[-1] == "spine.001" for name in names):
        keys = [
            ("", _RIGIFY.get(re.split(r"[:|-]", n)[-1], k[1])) if not k[0] else k
            for n, k in zip(names, keys, strict=True)
        ]
    joint = {key: k for k, key in reversed(list(enumerate(keys)))}
    roles: dict[str, int] = {}
    for side, table in (("", _MIDDLE), *((side, _SIDED) for side in SIDES)):
        for role, words in table.items():
            found = next(
                (joint[side, w] for w in words if joint.get((side, w)) not in (None, *roles.values())), None
            )
            if found is not None:
                roles[side + role] = found
    for side in SIDES:  # a shoulder is an upper arm where the elbow hangs on it
        for role, below, word in (("Arm", "ForeArm", "shoulder"), ("UpLeg", "Leg", "hip")):
            j, end = roles.get(side + role), roles.get(side + below)
            if j is not None and keys[j][1] == word and end is not None and int(parents[end]) != j:
                del roles[side + role]
    if "Neck" not in roles and "Head" in roles:
        roles["Neck"] = roles["Head"]
    spine = chain_between(roles, parents)
    return roles | {f"Spine{k}": joint for k, joint in enumerate(spine)}


def chain_between(roles: Mapping[str, int], parents: np.ndarray) -> list[int]:
    """Return the joints between the hips and the neck, from below."""
    chain, k = [], roles.get("Neck", -1)
    while k >= 0 and k != roles.get("Hips", -1):
        chain.append(k)
        k = int(parents[k])
    return chain[:0:-1] if k >= 0 else []


def match_joints(
    names: Sequence[str], parents: np.ndarray, body_names: Sequence[str], body_parents: np.ndarray
) -> dict[str, str]:
    """Return body joint -> file joint by what they are; joints that neither role nor name joins are left out.

    The spines are joined from the chest down: where the file's is shorter, the body's lowest have none.
    """
    there, here = roles_of(names, parents), roles_of(body_names, body_parents)
    pairs = {j: there[role] for role, j in here.items() if role in there and not role.startswith("Spine")}
    spine, body_spine = chain_between(there, parents), chain_between(here, body_parents)
    for i, j in enumerate(body_spine):
        m, n = len(spine), len(body_spine)
        k = round((i + 1) * m / n) - 1 if m >= n else i - (n - m)
        if k >= 0:
            pairs[j] = spine[k]
    keys = {_key(name): k for k, name in reversed(list(enumerate(without_numbers(names))))}
    taken = set(pairs.values())
    for j, name in enumerate(without_numbers(body_names)):
        k = keys.get(_key(name))
        if j not in pairs and k is not None and k not in taken and j not in here.values():
            pairs[j] = k
    return {body_names[j]: names[k] for j, k in sorted(pairs.items())}


def missing_joints(
    table: Mapping[str, str], body_names: Sequence[str], body_parents: np.ndarray
) -> list[str]:
    """Return the body's joints that a motion needs and `table` lacks; the role's name if unknown."""
    here = roles_of(body_names, body_parents)
    return [
        body_names[here[role]] if role in here else role
        for role in NEEDED
        if role not in here or body_names[here[role]] not in table
    ]


def table_to_fill(table: Mapping[str, str], body_names: Sequence[str], names: Sequence[str]) -> str:
    """Return the lines of a joint table: what was guessed, empty strings for the others, the file's names."""

    def quoted(text: str) -> str:
        return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

    def key(text: str) -> str:
        return text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else quoted(text)

    lines = [f"{key(name)} = {quoted(table.get(name, ''))}" for name in body_names]
    return "\n".join([*lines, f"# of {', '.join(names)}"])
