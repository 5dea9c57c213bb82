#include "models/model.hpp"

#include <cmath>

#include "models/duffing.hpp"
#include "models/free_pendulum.hpp"
#include "models/lotka_volterra.hpp"
#include "models/parametric_pendulum.hpp"
#include "tests/catch.hpp"

namespace orbid::models {
namespace {

// The least that a model is: tables and equations.
struct Pendulum {
    static constexpr std::array coordinates{angle("phi", "rad"), real("omega", "rad/s")};
    static constexpr std::array parameters{Parameter{"g", "m/s^2", positive, 9.81, "gravity"},
                                           Parameter{"l", "m", positive, 1.0, "length"},
                                           Parameter{"c", "1/s", nonnegative, 0.0, "linear damping", typical(0.1)}};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 3>& p) {
        using std::sin;
        const auto& [g, l, c] = p;
        return {x[1], -g / l * sin(x[0]) - c * x[1]};
    }
};
struct WithoutTables {
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 3>&) {
        return x;
    }
};
struct WithoutEquations {
    static constexpr auto coordinates = Pendulum::coordinates;
    static constexpr auto parameters = Pendulum::parameters;
};
// Equations for double only: no derivatives.
struct PlainOnly : WithoutEquations {
    static State<double, 2> rhs(const double&, const State<double, 2>& x, const Values<double, 3>&) { return x; }
};
struct WrongLength : WithoutEquations {
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 4>&) {
        return x;
    }
};
struct ForcedByNothing : Pendulum {
    static constexpr std::size_t forcing_frequency = 3;
};
// A frequency that may be 0 has no period.
struct ForcedByNonnegative : Pendulum {
    static constexpr std::size_t forcing_frequency = 2;
};
struct OneSided : WithoutEquations {
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 3>& p, double side) {
        return {x[1], -side * p[2]};
    }
};
struct OneSignTooMany : Pendulum {
    static constexpr std::array<double, 3> symmetry_signs{-1.0, -1.0, 1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
struct ReadsOneNumber : Pendulum {
    template <class T>
    static T instrument(const State<T, 2>& x, const Values<T, 3>&) {
        return x[0];
    }
};

using Crank = ParametricPendulum<Support::crank>;

static_assert(Model<Pendulum> && Model<Crank> && Model<FreePendulum> && Model<Duffing> && Model<LotkaVolterra>);
static_assert(!Model<WithoutTables> && !Model<WithoutEquations> && !Model<PlainOnly> && !Model<WrongLength>);
static_assert(ForcedModel<Crank> && ForcedModel<Duffing>);
static_assert(!ForcedModel<Pendulum> && !ForcedModel<ForcedByNothing> && !ForcedModel<ForcedByNonnegative>);
static_assert(SwitchingModel<Crank> && SwitchingModel<FreePendulum>);
static_assert(!SwitchingModel<Duffing> && !SwitchingModel<OneSided>);  // the latter does not say when it is smooth
static_assert(SymmetricModel<Crank> && SymmetricModel<Duffing>);
static_assert(!SymmetricModel<LotkaVolterra> && !SymmetricModel<OneSignTooMany>);
static_assert(InstrumentModel<FreePendulum>);
static_assert(!InstrumentModel<Crank> && !InstrumentModel<ReadsOneNumber>);
static_assert(VariantModel<Crank> && !VariantModel<Duffing>);
static_assert(ReducedModel<Crank> && !ReducedModel<Duffing>);
static_assert(DescribedModel<Crank> && !DescribedModel<Pendulum>);

}  // namespace

TEST_CASE("the support of the pendulum accelerates as the crank height does", "[models][reference]") {
    // Independent of (M2): second difference of A cos wt + L sqrt(1 - e^2 sin^2 wt), e = A / L.
    const double l = 0.317, g = 9.81, A = 0.131, w = 9.09, e = 0.173;
    const Values<double, 9> p{0.0858, l, 0.0, 4.85e-4, 1.9e-4, g, A, w, e};
    const auto c = Crank::reduced(p);
    const auto height = [&](long double phase) {
        const long double s = std::sin(phase);
        return A * std::cos(phase) + A / e * std::sqrt(1.0L - static_cast<long double>(e) * e * s * s);
    };
    const auto printed = ParametricPendulum<Support::crank_as_printed>::reduced(p);
    double largest_misprint = 0.0;
    for (const double phase : {0.0, 0.3, 1.0, 2.5, 4.0, 6.0}) {
        CAPTURE(phase);
        const long double h = 1e-4L;
        const auto acceleration =
            static_cast<double>((height(phase + h) - 2 * height(phase) + height(phase - h)) / (h * h) * w * w);
        // Truncation h^2 / 12 times the fourth derivative (about A w^2 = 11): 1e-8, divided by l.
        CHECK_THAT(Crank::stiffness(phase, c), tests::WithinAbs((g + acceleration) / l, 1e-7));
        largest_misprint = std::max(largest_misprint,
                                    std::abs(Crank::stiffness(phase, c) -
                                             ParametricPendulum<Support::crank_as_printed>::stiffness(phase, printed)));
    }
    CHECK(largest_misprint > 0.05);
    // Support at its highest: downward acceleration A w^2 (1 + e).
    CHECK_THAT(Crank::stiffness(0.0, c), tests::WithinAbs((g - A * w * w * (1.0 + e)) / l, 1e-12));
    CHECK_THAT(ParametricPendulum<Support::harmonic>::stiffness(0.0, c), tests::WithinAbs((g - A * w * w) / l, 1e-12));
}

}  // namespace orbid::models
