# SPDX-License-Identifier: BSD-2-Clause
"""Arms for the tests: one with published reference values, random ones, and what they run with."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from ..reference import arm as reference
from .cases import DEEP_SPACE, random_direction, random_inertia

FREE = {"joint_lock": (0,) * 7}
SPACE = DEEP_SPACE | {"max_step": 0.01}

# ---- KUKA LBR iiwa on a base of 200 kg: geometry and masses from kuka_iiwa.urdf of SPART (Orebro
# University, BSD-like); every number below `OTHERS` by Pinocchio 4.1 (BSD-2) and MuJoCo 4.0
# (Apache-2)
P, Q = 1.57079632679, 3.14159265359
IIWA = (  # joint in its parent: xyz, rpy; link: mass, centre, moments of inertia
    ((0, 0, 0.1575), (0, 0, 0), 4, (0, -0.03, 0.12), (0.1, 0.09, 0.02)),
    ((0, 0, 0.2025), (P, 0, Q), 4, (0.0003, 0.059, 0.042), (0.05, 0.018, 0.044)),
    ((0, 0.2045, 0), (P, 0, Q), 3, (0, 0.03, 0.13), (0.08, 0.075, 0.01)),
    ((0, 0, 0.2155), (P, 0, 0), 2.7, (0, 0.067, 0.034), (0.03, 0.01, 0.029)),
    ((0, 0.1845, 0), (-P, Q, 0), 1.7, (0.0001, 0.021, 0.076), (0.02, 0.018, 0.005)),
    ((0, 0, 0.2155), (P, 0, 0), 1.8, (0, 0.0006, 0.0004), (0.005, 0.0036, 0.0047)),
    ((0, 0.081, 0), (-P, Q, 0), 0.3, (0, 0, 0.02), (0.001, 0.001, 0.001)),
)
BASE_CENTRE = np.array((0, 0, -0.5))
"""Centre of mass of the base in the frame of the URDF's root link."""


def iiwa() -> reference.Arm:
    """Every link frame turned to the axes that it has at joint angle zero."""
    R, rows = np.eye(3), []
    for xyz, rpy, mass, centre, moments in IIWA:
        offset = R @ xyz - (BASE_CENTRE if not rows else 0)
        R = R @ Rotation.from_euler("xyz", rpy).as_matrix()
        L = R @ np.diag(moments) @ R.T
        rows.append((R[:, 2], offset, mass, R @ centre, np.diag(L), (L[0, 1], L[0, 2], L[1, 2])))
    axis, offset, mass, centre, moments, products = map(np.array, zip(*rows, strict=True))
    q_EA = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    return reference.Arm(
        *(axis, offset, mass, centre, moments, products, np.zeros(7), np.zeros(3), q_EA),
        mass_0=200.0,
        J_S=np.diag((40.0, 50, 45)),
    )


SHIFT = np.eye(6)
"""Velocity of S from the velocity of the URDF's root frame: v_S = v_O + w x s."""
SHIFT[:3, 3:] = np.stack([np.cross(e, BASE_CENTRE) for e in np.eye(3)], axis=-1)


class Published:
    """State of the case, and its published reference values."""

    q = np.array((0.3, -0.5, 0.4, 0.9, -0.2, 0.6, 0.1))
    dq = np.array((0.1, -0.2, 0.15, 0.05, -0.1, 0.2, -0.3))
    root = np.array((0.1, -0.2, 0.3))
    attitude = Rotation.from_rotvec(0.4 * np.array((1, 2, 3)) / np.sqrt(14))
    v_root = np.array((0.02, -0.01, 0.03))  # body axes
    w = np.array((0.01, 0.02, -0.015))
    torque = np.array((0.5, -0.4, 0.3, 0.2, -0.1, 0.05, -0.02))
    mass_matrix = (
        (
            217.5,
            0,
            0,
            0,
            -90.23241243253945,
            1.3889578055637406,
            1.3889578055637404,
            3.627973973850828,
            0.7207711271467978,
            -0.08223122153343063,
            -0.00425878628429858,
            0.018506957366014758,
            0,
        ),
        (
            217.5,
            0,
            90.23241243253945,
            0,
            -2.999971556480387,
            -2.999971556480387,
            1.1222638627363652,
            -0.8797844616553421,
            -0.40616191193720486,
            0.018134161359006227,
            0.012853270613703612,
            0,
        ),
        (
            217.5,
            -1.3889578055637406,
            2.999971556480387,
            0,
            0,
            3.2764473919887958,
            0.23413698276306705,
            -1.4308842760588365,
            0.034417502961724675,
            0.0218401090561246,
            0,
        ),
        (
            96.7557230457466,
            -0.5641808659375646,
            2.3027881628097173,
            2.302788162809717,
            -1.496753663890497,
            0.6236708728808864,
            0.717813171272611,
            -0.03139934220465913,
            -0.021694090087373875,
            -0.0005651514679053327,
        ),
        (
            107.51441625110735,
            1.09514377549917,
            1.09514377549917,
            3.9877477272200923,
            0.6903970094004143,
            -0.7462074800611675,
            0.0032171247671793305,
            0.03330296298416192,
            -0.0004062873980551407,
        ),
        (
            46.49944265271646,
            1.4994426527164584,
            0.21707722651108016,
            0.6287771811506353,
            0.1710158481813561,
            -0.010256768412672783,
            -0.0012161292356105496,
            0.000718007220371795,
        ),
        (
            1.4994426527164584,
            0.21707722651108016,
            0.6287771811506353,
            0.1710158481813561,
            -0.010256768412672783,
            -0.0012161292356105496,
            0.000718007220371795,
        ),
        (
            2.8848303410298444,
            0.3209635558515302,
            -0.8535160169720809,
            0.011888019394221938,
            0.030494219490222112,
            -0.00022112749783998001,
        ),
        (
            0.3501649574036209,
            -0.01018875403842712,
            0.0017170727692371792,
            0.0029751907411131677,
            0.0009465199436060063,
        ),
        (0.5400286460473079, -0.010644124447155477, -0.01873947089176282, 0.00011217714233246384),
        (0.011772249449941393, -3.565449402927688e-07, 0.0008253356149096784),
        (0.008760948, 0),
        (0.001,),
    )
    """Upper triangle by rows from the diagonal on; linear and angular speeds of the root frame."""
    energy = 0.1798582207114779
    tip = np.array((-0.1259639412264472, -0.7424306030492344, 1.2048523547753949))
    jacobian = np.array(
        [
            (
                0.39228559916542893,
                0.43416545688326497,
                0.25252487057410195,
                -0.09880100665351661,
                -0.03534004020668635,
                0.04627892577276636,
                4.076744824843e-06,
            ),
            (
                -0.34112024138248315,
                0.17883341875357636,
                -0.15897098092019954,
                -0.10663731065640995,
                0.025791939756215534,
                0.04197173961864906,
                -3.390347603505e-06,
            ),
            (
                -0.10996559854162835,
                0.4886257249998608,
                -0.004660842903052981,
                -0.4202272654131924,
                0.010054829914634945,
                0.04975561162435737,
                -1.076357075906e-06,
            ),
            (
                0.17218515152367136,
                -0.5091036265095419,
                -0.19762193977935005,
                0.813881014935953,
                -0.5247652989880423,
                -0.7779792257050138,
                -0.2398475524622004,
            ),
            (
                -0.10970973149473456,
                0.7435375376445361,
                -0.3610716600441797,
                -0.548741347311934,
                -0.8071180473309792,
                0.5831497084221264,
                -0.6166351587206154,
            ),
            (
                0.9545709459545898,
                0.1673447854567785,
                0.9109361863111028,
                -0.03898007449562541,
                0.2687676353482498,
                0.23070719826143224,
                0.7497956397073064,
            ),
        ]
    )
    """Generalized, of the origin of link 7, inertial axes, rows velocity and rate."""
    manipulability = 0.030690794720891125
    dw = np.array((-0.019163421932688184, 0.009154421221898844, -0.011155555555555556))
    ddq = np.array(
        (
            -0.6652203456483692,
            -0.44395791654393774,
            2.4716402792511776,
            0.03204249372551854,
            -7.945203158660259,
            6.161621120002792,
            -15.436014687169592,
        )
    )
    a_root = np.array((0.005110940697757185, 0.01187945171601085, 0.00542354456860668))
    """Spatial acceleration of the root frame, body axes: without w x v."""
    momentum = np.array((3.792361497893613, -1.5474959264745562, 5.060753175950241))
    h = np.array((1.0900599906461506, 1.037124433622649, -0.613934263660028))
    """About the centre of mass, inertial axes."""
    small_torque = np.array((0.05, -0.04, 0.03, 0.02, -0.01, 0.005, -0.002))
    recording: ClassVar[dict] = {  # t: root frame, rate, joint angles
        2: (
            (0.15533887186458956, -0.21046240238466368, 0.3503853644670854),
            (0.009609330883737324, 0.017039694919295693, -0.017301189978988045),
            (
                0.42543289373225573,
                -1.0818655077455859,
                1.1806347514020021,
                0.9220516507328499,
                -2.188792416740363,
                1.2811573351458183,
                -4.049831496438897,
            ),
        ),
        5: (
            (0.2101498028290052, -0.25799222810317957, 0.436689034562162),
            (0.03444338528387806, -0.007202091974571424, -0.0206526154147681),
            (
                1.6321615031147787,
                -2.531923808820897,
                3.4408450351533335,
                1.8481686458896527,
                -12.028909733536748,
                -0.31671261633396125,
                -21.841344231396448,
            ),
        ),
        10: (
            (0.3403011728229562, -0.39512104047496466, 0.5020590289700393),
            (0.001324434846693826, 0.0483583351132897, -0.02660045513580061),
            (
                4.865372607484924,
                -1.88678593338506,
                6.702378325325273,
                -1.7529813894448658,
                -31.77558714428314,
                -7.3456337226444575,
                -91.71657876315176,
            ),
        ),
    }
    attitude_10 = np.array(
        (0.15953141869399406, 0.19546805367297862, 0.04732776054948453, 0.9664895496197302)
    )  # scalar last

    # a target grasped at once at the origin of link 7: impulse on it, inertial axes (N s, N m s)
    impulse = np.array(
        (
            *(-0.5467343684787666, -1.0716749448949325, -0.07392676580957488),
            *(-0.06096433901219182, 0.03653203319565031, 0.010274376488670975),
        )
    )
    v_root_after = np.array((0.022219393663612447, -0.008620894056079754, 0.027794017552833998))
    w_after = np.array((0.007977985115295858, 0.022762278813197066, -0.015))
    dq_after = np.array(
        (
            *(-0.045712525414155464, 0.04491065960034532, 0.057268168012316864),
            *(0.18611238812079312, 0.0305563354869596, 0.10217871372131894, 0.024566842433402125),
        )
    )

    @classmethod
    def H(cls) -> np.ndarray:
        """Symmetric, speeds of the root frame."""
        H = np.zeros((13, 13))
        for i, row in enumerate(cls.mass_matrix):
            H[i, i:] = H[i:, i] = row
        return H

    @classmethod
    def start(cls) -> dict:
        """Parameters of arm_servicer in this state."""
        v_S = cls.v_root + np.cross(cls.w, BASE_CENTRE)
        C = cls.attitude.as_matrix()
        return iiwa().parameters() | {
            **SPACE,
            "r_0_N": cls.root + C @ BASE_CENTRE,
            "v_0_N": C @ v_S,
            "sigma_SN_0": np.tan(0.1) * np.array((1, 2, 3)) / np.sqrt(14),
            "omega_SN_S_0": cls.w,
            "joint_angle_0": cls.q,
            "joint_rate_0": cls.dq,
        }


# ---- random arms
def random_arm(rng, n: int) -> reference.Arm:
    """Axes, centres and inertias in all directions."""
    L = [random_inertia(rng, 0.02, 0.3) for _ in range(n)]
    products = [(J[0, 1], J[0, 2], J[1, 2]) for J in L]
    q = rng.normal(size=4)
    return reference.Arm(
        joint_axis=np.reshape([random_direction(rng) for _ in range(n)], (n, 3)),
        joint_offset=rng.uniform(-0.6, 0.6, (n, 3)),
        link_mass=rng.uniform(2, 6, n),
        link_centre=rng.uniform(-0.3, 0.3, (n, 3)),
        link_inertia=np.reshape([np.diag(J) for J in L], (n, 3)),
        link_products=np.reshape(products, (n, 3)),
        joint_inertia=rng.uniform(0, 0.5, n),
        p_EA_A=rng.uniform(-0.3, 0.3, 3),
        q_EA=q / np.linalg.norm(q),
        mass_0=rng.uniform(80, 140),
        J_S=random_inertia(rng),
    )


def moving(rng, n: int) -> dict:
    """A start in the middle of a motion, attitude and wheels included."""
    return {
        "sigma_SN_0": rng.uniform(-0.4, 0.4, 3),
        "omega_SN_S_0": rng.uniform(-0.05, 0.05, 3),
        "wheel_speed_0": rng.normal(size=3),
        "r_0_N": rng.normal(size=3),
        "v_0_N": rng.normal(size=3),
        "joint_angle_0": np.concatenate((rng.uniform(-2, 2, n), np.full(7 - n, 9.0))),
        "joint_rate_0": np.concatenate((rng.uniform(-0.3, 0.3, n), np.full(7 - n, 9.0))),
    }
