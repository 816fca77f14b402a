"""The joints of the motion libraries' skeletons, read off published files; `layouts.py` reads the lines.

A line is "name < parent: segment, axes, place": `{S}` is Left and Right, `{s}` l and r, `{U}` L and R.
"""

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")


def fingers(name: str, hand: str, axes: str, *, per_finger: int = 3) -> str:
    """Lines of both hands' fingers; `name` and `hand` hold `{S}` etc., `{F}` the finger, `{K}` its number."""
    lines = []
    for finger in FINGERS:
        for k in range(1, per_finger + 1):
            above = hand if k == 1 else name.replace("{F}", finger).replace("{K}", str(k - 1))
            own = name.replace("{F}", finger).replace("{K}", str(k))
            lines.append(f"{own} < {above}: {{S}}Hand{finger}{k}, {axes}")
    return "\n".join(lines)


# LaFAN1: 22 joints, every bone along the joint's own X; the root's position in the world.
LAFAN = """
Hips <: Hips, X=up Z=left
{S}UpLeg < Hips: {S}UpLeg, X+ Y=forward
{S}Leg < {S}UpLeg: {S}Leg, X+ Y=forward
{S}Foot < {S}Leg: {S}Foot, X+ Y=up
{S}Toe < {S}Foot: {S}Toe, X=forward Y=up
Spine < Hips: Spine, X=up Z=left
Spine1 < Spine: Spine1, X=up Z=left
Spine2 < Spine1: Spine2, X=up Z=left
Neck < Spine2: Neck, X=up Z=left
Head < Neck: Head, X=up Z=left
{S}Shoulder < Spine2: {S}Shoulder, X+ Y=back
{S}Arm < {S}Shoulder: {S}Arm, X+ Y=back
{S}ForeArm < {S}Arm: {S}ForeArm, X+ Y=back
{S}Hand < {S}ForeArm: {S}Hand, X+ Y=back
"""
# Bandai-Namco's research data sets: a root that never moves above the hips, six channels everywhere, bones
# along X on the left side and along -X on the right.
BANDAI = """
joint_Root <: ,
Hips < joint_Root: Hips, X=up Y=right
Spine < Hips: Spine, X=up Z=left
Chest < Spine: Spine2, X=up Z=left
Neck < Chest: Neck, X=up Z=left
Head < Neck: Head, X=up Z=left
Shoulder_{U} < Chest: {S}Shoulder, X+ Z=forward|X- Z=back
UpperArm_{U} < Shoulder_{U}: {S}Arm, X+ Z=forward|X- Z=back
LowerArm_{U} < UpperArm_{U}: {S}ForeArm, X+ Z=forward|X- Z=back
Hand_{U} < LowerArm_{U}: {S}Hand, X+ Y=forward|X- Y=back
UpperLeg_{U} < Hips: {S}UpLeg, X+ Y=left|X- Y=left
LowerLeg_{U} < UpperLeg_{U}: {S}Leg, X+ Y=left|X- Y=left
Foot_{U} < LowerLeg_{U}: {S}Foot, X+ Y=left|X- Y=left
Toes_{U} < Foot_{U}: {S}Toe, X+ Y=left|X- Y=left
"""
# Rokoko Studio with Mixamo's names: fingers hang from metacarpals, the last row is one too many.
ROKOKO = """
Hips <: Hips,
Spine < Hips: Spine, X=up Z=forward
Spine1 < Spine: Spine1, X=up Z=forward
Spine2 < Spine1: Spine2, X=up Z=forward
{S}Shoulder < Spine2: {S}Shoulder, X+ Y=up
{S}Arm < {S}Shoulder: {S}Arm, X+ Y=up
{S}ForeArm < {S}Arm: {S}ForeArm, X+ Y=up
{S}Hand < {S}ForeArm: {S}Hand, X+ Y=up
{S}InHandIndex < {S}Hand: {S}Hand, X+ Y=up, 0.03 0 0.016
{S}HandIndex1 < {S}InHandIndex: {S}HandIndex1, X+ Y=up
{S}HandIndex2 < {S}HandIndex1: {S}HandIndex2, X+ Y=up
{S}HandIndex3 < {S}HandIndex2: {S}HandIndex3, X+ Y=up
{S}InHandPinky < {S}Hand: {S}Hand, X+ Y=up, 0.025 0 -0.016
{S}HandPinky1 < {S}InHandPinky: {S}HandPinky1, X+ Y=up
{S}HandPinky2 < {S}HandPinky1: {S}HandPinky2, X+ Y=up
{S}HandThumb1 < {S}Hand: {S}HandThumb1, X+ Y=up
{S}HandThumb2 < {S}HandThumb1: {S}HandThumb2, X+ Y=up
{S}HandThumb3 < {S}HandThumb2: {S}HandThumb3, X+ Y=up
Neck < Spine2: Neck, X=up Z=forward
Head < Neck: Head, X=up Z=forward
{S}UpLeg < Hips: {S}UpLeg, X+ Z=forward
{S}Leg < {S}UpLeg: {S}Leg, X+ Z=forward
{S}Foot < {S}Leg: {S}Foot, X+ Y=up
{S}ToeBase < {S}Foot: {S}Toe, X=forward Y=up
"""
# Rokoko Studio's own names.
ROKOKO_OWN = """
Hips <: Hips,
{S}Thigh < Hips: {S}UpLeg, X+ Z=forward
{S}Shin < {S}Thigh: {S}Leg, X+ Z=forward
{S}Foot < {S}Shin: {S}Foot, X+ Y=up
{S}Toe < {S}Foot: {S}Toe, X=forward Y=up
{S}ToeTip < {S}Toe: {S}Toe, X=forward Y=up, 0 0 0.06
Spine1 < Hips: Spine, X=up Z=forward
Spine2 < Spine1: Spine, X=up Z=forward, 0 0.05 0
Spine3 < Spine2: Spine1, X=up Z=forward
Spine4 < Spine3: Spine2, X=up Z=forward
Neck < Spine4: Neck, X=up Z=forward
Head < Neck: Head, X=up Z=forward
{S}Shoulder < Spine4: {S}Shoulder, X+ Y=up
{S}Arm < {S}Shoulder: {S}Arm, X+ Y=up
{S}ForeArm < {S}Arm: {S}ForeArm, X+ Y=up
{S}Hand < {S}ForeArm: {S}Hand, X+ Y=up
{S}Finger1Metacarpal < {S}Hand: {S}HandThumb1, X+ Y=up
{S}Finger1Proximal < {S}Finger1Metacarpal: {S}HandThumb2, X+ Y=up
{S}Finger1Distal < {S}Finger1Proximal: {S}HandThumb3, X+ Y=up
{S}Finger2Metacarpal < {S}Hand: {S}Hand, X+ Y=up, 0.03 0 0.016
{S}Finger2Proximal < {S}Finger2Metacarpal: {S}HandIndex1, X+ Y=up
{S}Finger2Medial < {S}Finger2Proximal: {S}HandIndex2, X+ Y=up
{S}Finger2Distal < {S}Finger2Medial: {S}HandIndex3, X+ Y=up
"""
MIXAMO = """
mixamorig:Hips <: Hips, @Y=up Z=forward
mixamorig:Spine < mixamorig:Hips: Spine, @Y=up Z=forward
mixamorig:Spine1 < mixamorig:Spine: Spine1, @Y=up Z=forward
mixamorig:Spine2 < mixamorig:Spine1: Spine2, @Y=up Z=forward
mixamorig:Neck < mixamorig:Spine2: Neck, @Y=up Z=forward
mixamorig:Head < mixamorig:Neck: Head, @Y=up Z=forward
mixamorig:HeadTop_End < mixamorig:Head: Head, @Y=up Z=forward, 0 0.18 0
mixamorig:{S}Shoulder < mixamorig:Spine2: {S}Shoulder, @Y+ Z=down
mixamorig:{S}Arm < mixamorig:{S}Shoulder: {S}Arm, @Y+ Z=down
mixamorig:{S}ForeArm < mixamorig:{S}Arm: {S}ForeArm, @Y+ Z=down
mixamorig:{S}Hand < mixamorig:{S}ForeArm: {S}Hand, @Y+ Z=down
mixamorig:{S}UpLeg < mixamorig:Hips: {S}UpLeg, @Y+ Z=forward
mixamorig:{S}Leg < mixamorig:{S}UpLeg: {S}Leg, @Y+ Z=forward
mixamorig:{S}Foot < mixamorig:{S}Leg: {S}Foot, @Y+ Z=up
mixamorig:{S}ToeBase < mixamorig:{S}Foot: {S}Toe, @Y=forward Z=up
mixamorig:{S}Toe_End < mixamorig:{S}ToeBase: {S}Toe, @Y=forward Z=up, 0 0 0.06
""" + fingers("mixamorig:{S}Hand{F}{K}", "mixamorig:{S}Hand", "@Y+ Z=down")
# The CMU data base in Poser's names ("Daz-friendly"): no toes, hips on buttocks.
CMU_DAZ = """
hip <: Hips,
abdomen < hip: Spine,
chest < abdomen: Spine2,
neck < chest: Neck,
head < neck: Head,
leftEye < head: Head, , 0.04 0.08 0.08
rightEye < head: Head, , -0.04 0.08 0.08
{s}Collar < chest: {S}Shoulder,
{s}Shldr < {s}Collar: {S}Arm,
{s}ForeArm < {s}Shldr: {S}ForeArm,
{s}Hand < {s}ForeArm: {S}Hand,
{s}Thumb1 < {s}Hand: {S}HandThumb1,
{s}Thumb2 < {s}Thumb1: {S}HandThumb2,
{s}Index1 < {s}Hand: {S}HandIndex1,
{s}Index2 < {s}Index1: {S}HandIndex2,
{s}Mid1 < {s}Hand: {S}HandMiddle1,
{s}Mid2 < {s}Mid1: {S}HandMiddle2,
{s}Ring1 < {s}Hand: {S}HandRing1,
{s}Ring2 < {s}Ring1: {S}HandRing2,
{s}Pinky1 < {s}Hand: {S}HandPinky1,
{s}Pinky2 < {s}Pinky1: {S}HandPinky2,
{s}Buttock < hip: Hips, , 0.09 0.045 0.012
{s}Thigh < {s}Buttock: {S}UpLeg,
{s}Shin < {s}Thigh: {S}Leg,
{s}Foot < {s}Shin: {S}Foot,
"""
# The CMU data base with MotionBuilder's names: legs spread by 20 degrees at rest, several bones of length 0.
CMU = """
Hips <: Hips,
LHipJoint < Hips: Hips,
LeftUpLeg < LHipJoint: LeftUpLeg, spread-20
LeftLeg < LeftUpLeg: LeftLeg, spread-20
LeftFoot < LeftLeg: LeftFoot, spread-20
LeftToeBase < LeftFoot: LeftToe, spread-20
RHipJoint < Hips: Hips,
RightUpLeg < RHipJoint: RightUpLeg, spread20
RightLeg < RightUpLeg: RightLeg, spread20
RightFoot < RightLeg: RightFoot, spread20
RightToeBase < RightFoot: RightToe, spread20
LowerBack < Hips: Hips,
Spine < LowerBack: Spine,
Spine1 < Spine: Spine2,
Neck < Spine1: Spine2,
Neck1 < Neck: Neck,
Head < Neck1: Head,
{S}Shoulder < Spine1: {S}Shoulder,
{S}Arm < {S}Shoulder: {S}Arm,
{S}ForeArm < {S}Arm: {S}ForeArm,
{S}Hand < {S}ForeArm: {S}Hand,
{S}FingerBase < {S}Hand: {S}Hand,
{S}HandIndex1 < {S}FingerBase: {S}HandIndex1,
{S}Thumb < {S}Hand: {S}Hand,
"""
# 100STYLE: Xsens' skeleton.
STYLE = """
Hips <: Hips,
Chest < Hips: Spine,
Chest2 < Chest: Spine, , 0 0.06 0
Chest3 < Chest2: Spine1,
Chest4 < Chest3: Spine2,
Neck < Chest4: Neck,
Head < Neck: Head,
{S}Collar < Chest4: {S}Shoulder,
{S}Shoulder < {S}Collar: {S}Arm,
{S}Elbow < {S}Shoulder: {S}ForeArm,
{S}Wrist < {S}Elbow: {S}Hand,
{S}Hip < Hips: {S}UpLeg,
{S}Knee < {S}Hip: {S}Leg,
{S}Ankle < {S}Knee: {S}Foot,
{S}Toe < {S}Ankle: {S}Toe,
"""
# Unreal's mannequin: X along the bones on the right side, against them on the left; hips under `root`.
UNREAL = """
root <: ,
pelvis < root: Hips, X=up Z=right
spine_01 < pelvis: Spine, X=up Z=right
spine_02 < spine_01: Spine1, X=up Z=right
spine_03 < spine_02: Spine2, X=up Z=right
clavicle_{s} < spine_03: {S}Shoulder, X+ Z=up|X- Z=down
upperarm_{s} < clavicle_{s}: {S}Arm, X+ Z=up|X- Z=down
lowerarm_{s} < upperarm_{s}: {S}ForeArm, X+ Z=up|X- Z=down
hand_{s} < lowerarm_{s}: {S}Hand, X+ Z=forward|X- Z=back
index_01_{s} < hand_{s}: {S}HandIndex1, X+ Z=forward|X- Z=back
index_02_{s} < index_01_{s}: {S}HandIndex2, X+ Z=forward|X- Z=back
thumb_01_{s} < hand_{s}: {S}HandThumb1, X+ Z=forward|X- Z=back
thumb_02_{s} < thumb_01_{s}: {S}HandThumb2, X+ Z=forward|X- Z=back
neck_01 < spine_03: Neck, X=up Z=right
head < neck_01: Head, X=up Z=right
thigh_{s} < pelvis: {S}UpLeg, X- Z=left|X+ Z=left
calf_{s} < thigh_{s}: {S}Leg, X- Z=left|X+ Z=left
foot_{s} < calf_{s}: {S}Foot, X- Z=left|X+ Z=left
ball_{s} < foot_{s}: {S}Toe, X- Z=left|X+ Z=left
"""
