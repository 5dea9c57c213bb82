#pragma once

#include <array>
#include <cmath>
#include <string_view>

#include "models/model.hpp"

namespace orbid::models {

/// Two rigid arms on joints with viscous friction, read by encoders whose zeros are off.
///
///     J1 phi1'' + h cos(d) phi2'' = -h sin(d) phi2'^2 - (m1 a1 + m2 L1) g sin(phi1) - k1 phi1' + k2 (phi2' - phi1')
///     h cos(d) phi1'' + J2 phi2'' =  h sin(d) phi1'^2 - m2 a2 g sin(phi2) - k2 (phi2' - phi1')
///     d = phi1 - phi2,   J1 = I1 + m1 a1^2 + m2 L1^2,   J2 = I2 + m2 a2^2,   h = m2 L1 a2
///     readings: phi1 + offset1, phi2 + offset2
///
/// State, shape (4): phi1, phi2 [rad], both measured from hanging straight down (absolute, not relative to each other),
/// on the circle; phi1_dot, phi2_dot [rad/s]. For data that count from upright, pi = hanging, either subtract pi from
/// the columns or set the offsets to pi. Symmetric under reversal of all signs.
/// Arm i: mass mi, centre of mass ai from its upper joint, moment of inertia Ii about the centre of mass; L1 from joint
/// to joint. Only the six quotients of `reduced` can be told from motion.
/// Source: Lagrange's equations. Defaults: the estimates for the real arms of K. Kaheman, U. Fasel, J. J. Bramburger,
/// B. Strom, J. N. Kutz, S. L. Brunton, "The Experimental Multi-Arm Pendulum on a Cart: A Benchmark System for Chaos,
/// Learning, and Control" (2022), arXiv:2205.06231.
struct DoublePendulum {
    static constexpr std::string_view name = "double_pendulum";
    static constexpr std::string_view summary = "two arms on joints with viscous friction";
    static constexpr std::string_view equations =
        "J1 phi1'' + h cos(d) phi2'' = -h sin(d) phi2'^2 - (m1 a1 + m2 L1) g sin(phi1) - k1 phi1' + k2 (phi2' - "
        "phi1')\n"
        "h cos(d) phi1'' + J2 phi2'' = h sin(d) phi1'^2 - m2 a2 g sin(phi2) - k2 (phi2' - phi1')\n"
        "d = phi1 - phi2, J1 = I1 + m1 a1^2 + m2 L1^2, J2 = I2 + m2 a2^2, h = m2 L1 a2\n"
        "phi = 0 hanging, both angles absolute; the instrument reads phi1 + offset1, phi2 + offset2";

    static constexpr std::array coordinates{angle("phi1", "rad"), angle("phi2", "rad"), real("phi1_dot", "rad/s"),
                                            real("phi2_dot", "rad/s")};
    static constexpr std::array parameters{
        Parameter{"m1", "kg", positive, 0.0938439748, "mass of the upper arm"},
        Parameter{"m2", "kg", positive, 0.137595970, "mass of the lower arm"},
        Parameter{"a1", "m", positive, 0.108565215, "centre of mass of the upper arm from its joint"},
        Parameter{"a2", "m", positive, 0.116779018, "centre of mass of the lower arm from its joint"},
        Parameter{"L1", "m", positive, 0.172719204, "distance of the joints"},
        Parameter{"I1", "kg m^2", nonnegative, 4.37529430e-4, "inertia of the upper arm about its centre of mass"},
        Parameter{"I2", "kg m^2", nonnegative, 1.26882939e-3, "inertia of the lower arm about its centre of mass"},
        Parameter{"k1", "N m s", nonnegative, 2.37142783e-4, "friction of the upper joint"},
        Parameter{"k2", "N m s", nonnegative, 1.00000019e-5, "friction of the lower joint"},
        Parameter{"g", "m/s^2", positive, 9.80858023, "gravity"},
        // 0.01 rad: a degree or so, by which encoders are commonly mounted off.
        Parameter{"offset1", "rad", any_real, 0.0, "reading of the upper encoder when hanging", typical(0.01)},
        Parameter{"offset2", "rad", any_real, 0.0, "reading of the lower encoder when hanging", typical(0.01)}};
    static constexpr std::array<double, 4> symmetry_signs{-1.0, -1.0, -1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;

    /// J2 / J1, h / J1, (m1 a1 + m2 L1) g / J1, m2 a2 g / J1, k1 / J1, k2 / J1: all that the motion depends on.
    template <class T>
    static Values<T, 6> reduced(const Values<T, 12>& p) {
        const T &m1 = p[0], &m2 = p[1], &a1 = p[2], &a2 = p[3], &L1 = p[4], &g = p[9];
        const T J1 = p[5] + m1 * a1 * a1 + m2 * L1 * L1;
        return {(p[6] + m2 * a2 * a2) / J1, m2 * L1 * a2 / J1, (m1 * a1 + m2 * L1) * g / J1,
                m2 * a2 * g / J1,           p[7] / J1,         p[8] / J1};
    }

    template <class T>
    static State<T, 4> rhs(const T& /*t*/, const State<T, 4>& x, const Values<T, 6>& c) {
        using std::cos;
        using std::sin;
        const T &v1 = x[2], &v2 = x[3];
        const T difference = x[0] - x[1];
        const T coupling = c[1] * cos(difference), turning = c[1] * sin(difference);
        const T joint = c[5] * (v2 - v1);
        const T torque1 = joint - turning * v2 * v2 - c[2] * sin(x[0]) - c[4] * v1;
        const T torque2 = turning * v1 * v1 - c[3] * sin(x[1]) - joint;
        // J1 J2 > h^2 for any real arms, so the determinant is positive.
        const T determinant = c[0] - coupling * coupling;
        return {v1, v2, (c[0] * torque1 - coupling * torque2) / determinant,
                (torque2 - coupling * torque1) / determinant};
    }

    template <class T>
    static State<T, 4> instrument(const State<T, 4>& x, const Values<T, 12>& p) {
        return {x[0] + p[10], x[1] + p[11], x[2], x[3]};
    }
};

}  // namespace orbid::models
