#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <tuple>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Two rigid arms on joints with friction, read by encoders with an offset: base of the variants.
///
/// The variant `viscous`:
///
///     J1 phi1'' + h cos(d) phi2'' = -h sin(d) phi2'^2 - (m1 a1 + m2 L1) g sin(phi1) - k1 phi1' + k2 (phi2' - phi1')
///     h cos(d) phi1'' + J2 phi2'' =  h sin(d) phi1'^2 - m2 a2 g sin(phi2) - k2 (phi2' - phi1')
///     d = phi1 - phi2,   J1 = I1 + m1 a1^2 + m2 L1^2,   J2 = I2 + m2 a2^2,   h = m2 L1 a2
///     readings: phi1 + offset1, phi2 + offset2
///
/// State, shape (4): phi1, phi2 [rad], both measured from hanging straight down (absolute, not relative to each other),
/// on the circle; phi1_dot, phi2_dot [rad/s]. For data that count from upright, pi = hanging, either subtract pi from
/// the columns or set the offsets to pi. Symmetric under reversal of all signs. Arm i: mass mi, centre of mass ai from
/// its upper joint, moment of inertia Ii about the centre of mass; L1 from joint to joint. Motion determines only the
/// six quotients of `reduced`: with free masses and lengths g, I1 and I2 (say) have to be given. Source: Lagrange's
/// equations. Defaults: the estimates for the real arms of K. Kaheman, U. Fasel, J. J. Bramburger, B. Strom, J. N.
/// Kutz, S. L. Brunton, "The Experimental Multi-Arm Pendulum on a Cart: A Benchmark System for Chaos, Learning, and
/// Control" (2022), arXiv:2205.06231.
struct ArmsOnJoints {
    static constexpr std::string_view name = "double_pendulum";
    static constexpr std::string_view summary = "two arms on joints with friction";
    static constexpr std::string_view equations =
        "J1 phi1'' + h cos(d) phi2'' = -h sin(d) phi2'^2 - (m1 a1 + m2 L1) g sin(phi1) - k1 phi1' + k2 (phi2' - "
        "phi1')\n"
        "h cos(d) phi1'' + J2 phi2'' = h sin(d) phi1'^2 - m2 a2 g sin(phi2) - k2 (phi2' - phi1')\n"
        "d = phi1 - phi2, J1 = I1 + m1 a1^2 + m2 L1^2, J2 = I2 + m2 a2^2, h = m2 L1 a2\n"
        "phi = 0 hanging, both angles absolute; the instrument reads phi1 + offset1, phi2 + offset2\n"
        "variants: viscous (above); friction_and_drag: besides, dry friction c1 sgn(phi1'), c2 sgn(phi2' - phi1') of "
        "the\n"
        "joints, drag |w| w per length of both arms, w = velocity across the arm, the centre of mass of the upper arm "
        "off\n"
        "its line of joints by bend, and eccentric encoders on phi1 and on phi2 - phi1";

    static constexpr std::array coordinates{angle("phi1", "rad"), angle("phi2", "rad"), real("phi1_dot", "rad/s"),
                                            real("phi2_dot", "rad/s")};
    static constexpr std::array shared{
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
};

/// The variant `viscous`.
struct ViscousJoints : ArmsOnJoints {
    static constexpr std::string_view variant = "viscous";
    static constexpr std::array parameters = shared;

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
        using std::cos, std::sin;
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

/// The variant `friction_and_drag`: besides viscous friction
///
///     -c1 sgn(phi1') on the upper arm, c2 sgn(phi2' - phi1') between the arms: dry friction of the joints
///     drag |w| w per length of both arms, w the velocity across the arm at that place: w = r phi1' on the upper arm
///         (0 < r < L1), w = L1 cos(d) phi1' + r phi2' on the lower one (0 < r < L2)
///     -m1 a1 g sin(phi1 + bend) in the place of -m1 a1 g sin(phi1)
///     readings: phi1 + offset1 + E1, phi2 + offset2 + E1 + E2,   E1 = e1_cos (cos phi1 - 1) + e1_sin sin phi1,
///         E2 = e2_cos (cos q - 1) + e2_sin sin q,   q = phi2 - phi1
///
/// The encoders sit in the joints: the angle of the lower arm is the sum of both. An encoder with an eccentric code
/// wheel errs by the first harmonic of its angle. The cosine is counted from hanging, so that the offset stays the
/// reading there. Velocities are read as the readings' rates. Surfaces: phi1' = 0 and phi2' = phi1'; both held at once
/// is the end of a flow (FlowStatus::held_twice). Source: Lagrange's equations; drag of strips of a body across the
/// stream, drag = (1/2) density C_d width. Four strips at Gauss's points per arm: for one sign of w along the arm they
/// are exact.
struct JointsWithDryFriction : ArmsOnJoints {
    static constexpr std::string_view variant = "friction_and_drag";
    // Typical: 1e-4 N m is the friction of a miniature ball bearing. 0.01 kg/m^2 is the drag of a bar of a centimetre
    // or two in air (1.2 kg/m^3, C_d about 1). A wheel of 40 mm that runs out by 0.1 mm errs by 5 mrad.
    static constexpr auto parameters = joined(
        shared,
        std::array{
            Parameter{"c1", "N m", nonnegative, 0.0, "dry friction of the upper joint", typical(1e-4)},
            Parameter{"c2", "N m", nonnegative, 0.0, "dry friction of the lower joint", typical(1e-4)},
            Parameter{"drag", "kg/m^2", nonnegative, 0.0, "drag per length and squared velocity", typical(0.01)},
            Parameter{"L2", "m", positive, 0.26, "length of the lower arm in the air"},
            Parameter{"bend", "rad", any_real, 0.0, "centre of mass of the upper arm off its line of joints",
                      typical(0.01)},
            Parameter{"e1_cos", "rad", any_real, 0.0, "eccentricity of the upper encoder, cosine", typical(0.005)},
            Parameter{"e1_sin", "rad", any_real, 0.0, "eccentricity of the upper encoder, sine", typical(0.005)},
            Parameter{"e2_cos", "rad", any_real, 0.0, "eccentricity of the lower encoder, cosine", typical(0.005)},
            Parameter{"e2_sin", "rad", any_real, 0.0, "eccentricity of the lower encoder, sine", typical(0.005)}});

    static constexpr std::size_t surface_count = 2;

    static bool smooth(const Values<double, 21>& p) { return p[12] == 0.0 && p[13] == 0.0; }

    /// Over J1: J2, h, m2 L1 g, m2 a2 g, k1, k2, m1 a1 g, c1, c2, drag L1^4; then L2 / L1, bend.
    template <class T>
    static Values<T, 12> reduced(const Values<T, 21>& p) {
        const T &m1 = p[0], &m2 = p[1], &a1 = p[2], &a2 = p[3], &L1 = p[4], &g = p[9];
        const T J1 = p[5] + m1 * a1 * a1 + m2 * L1 * L1, square = L1 * L1;
        return {(p[6] + m2 * a2 * a2) / J1,
                m2 * L1 * a2 / J1,
                m2 * L1 * g / J1,
                m2 * a2 * g / J1,
                p[7] / J1,
                p[8] / J1,
                m1 * a1 * g / J1,
                p[12] / J1,
                p[13] / J1,
                p[14] * square * square / J1,
                p[15] / L1,
                p[16]};
    }

    template <class T>
    static Values<T, 2> surfaces(const T& /*t*/, const State<T, 4>& x, const Values<T, 12>& /*c*/) {
        return {x[2], x[3] - x[2]};
    }

    template <class T>
    static State<T, 4> rhs(const T& /*t*/, const State<T, 4>& x, const Values<T, 12>& c,
                           const std::array<double, 2>& side) {
        using std::abs, std::cos, std::sin;
        const T &v1 = x[2], &v2 = x[3];
        const T difference = x[0] - x[1];
        const T cosine = cos(difference);
        const T coupling = c[1] * cosine, turning = c[1] * sin(difference);
        const T joint = c[5] * (v2 - v1) + side[1] * c[8];
        // Lengths in units of L1. The upper arm in closed form: the integral of r (r v1)^2 is a quarter.
        T across{}, moment{};
        for (std::size_t i = 0; i < strips.size(); ++i) {
            const T r = strips[i].place * c[10];
            const T w = cosine * v1 + r * v2;
            const T force = strips[i].share * c[10] * w * abs(w);
            across = across + force;
            moment = moment + r * force;
        }
        const T torque1 = joint - turning * v2 * v2 - c[2] * sin(x[0]) - c[6] * sin(x[0] + c[11]) - c[4] * v1 -
                          side[0] * c[7] - c[9] * (0.25 * v1 * abs(v1) + cosine * across);
        const T torque2 = turning * v1 * v1 - c[3] * sin(x[1]) - joint - c[9] * moment;
        // J1 J2 > h^2 for any real arms, so the determinant is positive.
        const T determinant = c[0] - coupling * coupling;
        return {v1, v2, (c[0] * torque1 - coupling * torque2) / determinant,
                (torque2 - coupling * torque1) / determinant};
    }

    template <class T>
    static State<T, 4> instrument(const State<T, 4>& x, const Values<T, 21>& p) {
        using std::cos, std::sin;
        const T q = x[1] - x[0];
        const T cos1 = cos(x[0]), sin1 = sin(x[0]), cos2 = cos(q), sin2 = sin(q);
        const T upper = p[17] * (cos1 - 1.0) + p[18] * sin1;
        const T lower = p[19] * (cos2 - 1.0) + p[20] * sin2;
        const T upper_rate = (p[18] * cos1 - p[17] * sin1) * x[2];
        const T lower_rate = (p[20] * cos2 - p[19] * sin2) * (x[3] - x[2]);
        return {x[0] + p[10] + upper, x[1] + p[11] + upper + lower, x[2] + upper_rate, x[3] + upper_rate + lower_rate};
    }

private:
    struct Strip {
        double place;
        double share;
    };
    /// Gauss and Legendre's four points on (0, 1): polynomials to order 7.
    static constexpr std::array<Strip, 4> strips{
        Strip{0.069431844202973712, 0.17392742256872693}, Strip{0.33000947820757187, 0.32607257743127307},
        Strip{0.66999052179242813, 0.32607257743127307}, Strip{0.93056815579702629, 0.17392742256872693}};
};

/// The model as the registry lists it: its variants, the default first.
struct DoublePendulum {
    using variants = std::tuple<ViscousJoints, JointsWithDryFriction>;
};

}  // namespace orbid::models
