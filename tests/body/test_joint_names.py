import numpy as np
import pytest

from garment_jax.body.joint_names import match_joints, missing_joints, plain_name, roles_of, without_numbers
from garment_jax.procedural.skeleton import JOINT_NAMES, PARENTS

# one arm and one leg in the words of a program, with its hips, neck and head
PROGRAMS = {
    "Mixamo": "mixamorig1:Hips Spine Neck Head LeftShoulder LeftArm LeftForeArm "
    "LeftUpLeg LeftLeg LeftFoot LeftToeBase",
    "Unreal": "pelvis spine_01 neck_01 head clavicle_l upperarm_l lowerarm_l thigh_l calf_l foot_l ball_l",
    "VRM": "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Neck J_Bip_C_Head J_Bip_L_Shoulder J_Bip_L_UpperArm "
    "J_Bip_L_LowerArm J_Bip_L_UpperLeg J_Bip_L_LowerLeg J_Bip_L_Foot J_Bip_L_ToeBase",
    "Rigify": "DEF-spine DEF-spine.001 DEF-spine.004 DEF-spine.006 DEF-shoulder.L DEF-upper_arm.L "
    "DEF-forearm.L "
    "DEF-thigh.L DEF-shin.L DEF-foot.L DEF-toe.L",
    "Biped": "Bip01|Pelvis Bip01_Spine Bip01_Neck Bip01_Head Bip01_L_Clavicle "
    "Bip01_L_UpperArm Bip01_L_Forearm "
    "Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot Bip01_L_Toe0",
    "SMPL": "pelvis spine1 neck head left_collar left_shoulder left_elbow "
    "left_hip left_knee left_ankle left_foot",
    "100STYLE": "Hips Chest Neck Head LeftCollar LeftShoulder LeftElbow LeftHip LeftKnee LeftAnkle LeftToe",
    "Character Creator": "CC_Base_Hip CC_Base_Waist CC_Base_NeckTwist01 CC_Base_Head CC_Base_L_Clavicle "
    "CC_Base_L_Upperarm CC_Base_L_Forearm CC_Base_L_Thigh CC_Base_L_Calf CC_Base_L_Foot CC_Base_L_ToeBase",
    "Kinect": "SpineBase SpineMid Neck Head ClavicleLeft ShoulderLeft ElbowLeft HipLeft KneeLeft AnkleLeft "
    "FootLeft",
    "Blender's numbers": "Armature|Hips.001 Spine.001 Neck.001 Head.001 Shoulder_L.001 "
    "UpperArm_L.001 LowerArm_L.001 "
    "UpperLeg_L.001 LowerLeg_L.001 Foot_L.001 Toes_L.001",
}
ROLES = (
    "Hips",
    "Spine0",
    "Neck",
    "Head",
    "LeftShoulder",
    "LeftArm",
    "LeftForeArm",
    "LeftUpLeg",
    "LeftLeg",
    "LeftFoot",
)
ABOVE = np.array([-1, 0, 1, 2, 1, 4, 5, 0, 7, 8, 9])


@pytest.mark.parametrize("program", PROGRAMS)
def test_usual_skeletons_are_known(program: str):
    names = PROGRAMS[program].split()
    assert roles_of(names, ABOVE) == dict(zip((*ROLES, "LeftToeBase"), range(11), strict=True))


def test_a_shoulder_is_an_arm_only_where_the_elbow_hangs_on_it():
    names = ("Hips", "LeftShoulder", "Flipper", "LeftForeArm")
    parents = np.array([-1, 0, 1, 2])
    assert "LeftArm" not in roles_of(names, parents)
    parents[3] = 1
    assert roles_of(names, parents)["LeftArm"] == 1


def test_prefixes_and_sides_fall_away_on_both_sides():
    assert plain_name("Armature|mixamorig:LeftLeg.001") == "LeftLeg"
    prefixed = [f"mixamorig:{name}" for name in JOINT_NAMES]
    for here, there in ((JOINT_NAMES, prefixed), (prefixed, JOINT_NAMES), (prefixed, prefixed)):
        table = match_joints(there, PARENTS, here, PARENTS)
        assert table == dict(zip(here, there, strict=True))
    lacking = {a: b for a, b in table.items() if not a.endswith("LeftLeg")}
    assert missing_joints(lacking, prefixed, PARENTS) == ["mixamorig:LeftLeg"]


@pytest.mark.parametrize("prefix", ["mixamorig", "mixamorig1:", "Armature|mixamorig:", "Character1_", ""])
@pytest.mark.parametrize("numbered", [False, True])
def test_prefixes_without_a_colon_and_a_file_s_own_numbers_fall_away(prefix: str, numbered: bool):
    names = [prefix + name + (f"_{k:02d}" if numbered else "") for k, name in enumerate(JOINT_NAMES)]
    for here, there in ((JOINT_NAMES, names), (names, JOINT_NAMES)):
        assert match_joints(there, PARENTS, here, PARENTS) == dict(zip(here, there, strict=True))


def test_numbers_that_tell_joints_apart_stay():
    for names in (["pelvis", "spine_01", "spine_02", "index_01_l"], ["a_01", "b_01", "c_02"]):
        assert without_numbers(names) == names
