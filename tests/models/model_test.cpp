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
    [[maybe_unused]] static constexpr double symmetry_phase_shift = 0.0;
};
struct ReadsOneNumber : Pendulum {
    template <class T>
    static T instrument(const State<T, 2>& x, const Values<T, 3>&) {
        return x[0];
    }
};

using Crank = PendulumOn<Support::crank>;

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

}  // namespace orbid::models
