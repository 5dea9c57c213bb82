#include "models/definition/model.hpp"

#include <cmath>

#include "models/catalogue/duffing.hpp"
#include "models/catalogue/free_pendulum.hpp"
#include "models/catalogue/henon.hpp"
#include "models/catalogue/logistic.hpp"
#include "models/catalogue/lorenz96.hpp"
#include "models/catalogue/lotka_volterra.hpp"
#include "models/catalogue/parametric_pendulum.hpp"
#include "models/definition/model_check.hpp"
#include "tests/catch.hpp"

namespace orbid::models::model_test {
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

// x -> F(x): for numbers with derivatives too, and of the right length.
struct MapOfDoubles : WithoutEquations {
    static State<double, 2> map(const State<double, 2>& x, const Values<double, 3>&) { return x; }
};
struct MapToOneNumber : WithoutEquations {
    template <class T>
    static T map(const State<T, 2>& x, const Values<T, 3>&) {
        return x[0];
    }
};
// Measured inputs: a table, and rhs that takes their values.
struct Driven : WithoutEquations {
    static constexpr std::array inputs{real("u", "rad/s^2")};
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 3>& p, const std::array<T, 1>& u) {
        return {x[1], u[0] - p[2] * x[1]};
    }
};
struct InputsNotTaken : Pendulum {
    static constexpr std::array inputs{real("u", "rad/s^2")};
};
struct ForcedAndDriven : Driven {
    static constexpr std::size_t forcing_frequency = 0;
};
// A ball on a table: falls freely above, and is thrown back.
struct Ball : WithoutEquations {
    static constexpr std::size_t surface_count = 1;
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 3>& p, const std::array<double, 1>&) {
        return {x[1], -p[0]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 3>&) {
        return {x[0]};
    }
    static bool smooth(const Values<double, 3>&) { return false; }
};
struct BouncingBall : Ball {
    static constexpr std::array<bool, 1> impacts{true};
    template <class T>
    static State<T, 2> reset(std::size_t, const T&, const State<T, 2>& x, const Values<T, 3>&) {
        return {x[0], -x[1]};
    }
};
struct BallWithoutReset : Ball {
    static constexpr std::array<bool, 1> impacts{true};
};
struct SurfacesOfOtherNumber : Ball {
    static constexpr std::size_t surface_count = 2;
};
struct SurfacesNotSaid : OneSided {
    static constexpr std::size_t surface_count = 1;
};
struct Stiff : Pendulum {
    static constexpr bool stiff = true;
};
struct NotStiff : Pendulum {
    static constexpr bool stiff = false;
};
struct StiffMap : Logistic {
    [[maybe_unused]] static constexpr bool stiff = true;
};
struct RingTooSmall : Lorenz96 {
    static constexpr std::size_t default_size = 3;
};
struct RingWithCoordinates : Lorenz96 {
    static constexpr std::array coordinates{real("x", "1")};
};
struct RingReturningState : Lorenz96 {
    template <class T>
    static State<T, 4> rhs(const T&, std::span<const T>, const Values<T, 1>&, std::span<T>) {
        return {};
    }
};
struct NamedByNumber : Pendulum {
    static constexpr int variant = 1;
};
struct ReducedFromTooMany : Pendulum {
    template <class T>
    static Values<T, 3> reduced(const Values<T, 4>& p) {
        return {p[0], p[1], p[2]};
    }
};

using Crank = PendulumOn<Support::crank>;

static_assert(Model<Pendulum> && Model<Crank> && Model<PendulumWithQuadraticFriction> && Model<Duffing> &&
              Model<LotkaVolterra>);
static_assert(!Model<WithoutTables> && !Model<WithoutEquations> && !Model<PlainOnly> && !Model<WrongLength>);
static_assert(ForcedModel<Crank> && ForcedModel<Duffing>);
static_assert(!ForcedModel<Pendulum> && !ForcedModel<ForcedByNothing> && !ForcedModel<ForcedByNonnegative>);
static_assert(SwitchingModel<Crank> && SwitchingModel<PendulumWithQuadraticFriction>);
static_assert(!SwitchingModel<Duffing> && !SwitchingModel<OneSided>);  // the latter does not say when it is smooth
static_assert(SymmetricModel<Crank> && SymmetricModel<Duffing>);
static_assert(!SymmetricModel<LotkaVolterra> && !SymmetricModel<OneSignTooMany>);
static_assert(InstrumentModel<PendulumWithQuadraticFriction>);
static_assert(!InstrumentModel<Crank> && !InstrumentModel<ReadsOneNumber>);
static_assert(VariantModel<Crank> && !VariantModel<Duffing> && !VariantModel<NamedByNumber>);
static_assert(ReducedModel<Crank> && !ReducedModel<Duffing> && !ReducedModel<ReducedFromTooMany>);
static_assert(DescribedModel<Crank> && !DescribedModel<Pendulum>);
static_assert(MapModel<Henon> && MapModel<Logistic> && Model<Henon> && DescribedModel<Henon>);
static_assert(!MapModel<Pendulum> && !MapModel<MapOfDoubles> && !MapModel<MapToOneNumber>);
static_assert(!ForcedModel<Henon> && !SwitchingModel<Henon> && !StiffModel<StiffMap>);
static_assert(InputTable<Driven> && InputModel<Driven>);
static_assert(!InputTable<Pendulum> && !Model<InputsNotTaken> && !InputModel<ForcedAndDriven>);
static_assert(SurfaceTable<Ball> && SurfaceModel<Ball> && !ImpactModel<Ball> && !SwitchingModel<Ball>);
static_assert(!SurfaceModel<Crank> && !SurfaceModel<SurfacesOfOtherNumber> && !SurfaceModel<SurfacesNotSaid>);
static_assert(ImpactModel<BouncingBall> && SurfaceModel<BouncingBall> && !ImpactModel<BallWithoutReset>);
static_assert(StiffModel<Stiff> && !StiffModel<NotStiff> && !StiffModel<Pendulum>);
static_assert(DynamicModel<Lorenz96> && !Model<Lorenz96> && !DynamicModel<Pendulum>);
static_assert(!DynamicModel<RingTooSmall> && !DynamicModel<RingWithCoordinates> && !DynamicModel<RingReturningState>);
static_assert(is_complete<ParametricPendulum>() && is_complete<Henon>() && is_complete<Lorenz96>());

}  // namespace

}  // namespace orbid::models::model_test
