#include "tests/estimator/estimate/reference_model.hpp"

#include <array>
#include <string_view>

#include "models/kernels/model_system.hpp"

namespace orbid::tests {

namespace {

struct BockLotkaVolterra {
    static constexpr std::string_view name = "bock";
    static constexpr std::string_view summary = "predators and prey, Bock and Sager's form";
    static constexpr std::string_view equations = "x' = -x + p1 x y\ny' = y - p2 x y";
    static constexpr std::array coordinates{models::real("x", ""), models::real("y", "")};
    static constexpr std::array parameters{models::Parameter{"p1", "", models::any_real, 0.7, "predators won"},
                                           models::Parameter{"p2", "", models::any_real, 0.35, "prey lost"}};
    template <class T>
    static models::State<T, 2> rhs(const T& /*t*/, const models::State<T, 2>& x, const models::Values<T, 2>& p) {
        return {x[0] * (p[0] * x[1] - 1.0), x[1] * (1.0 - p[1] * x[0])};
    }
};

struct MichaelisMenten {
    static constexpr std::string_view name = "michaelis_menten";
    static constexpr std::string_view summary = "one compartment, saturated elimination";
    static constexpr std::string_view equations = "a' = -k_a a\nc' = k_a a - (V_m / 2) c / (K_m + c)";
    static constexpr std::array coordinates{models::real("a", ""), models::real("c", "")};
    static constexpr std::array parameters{models::Parameter{"k_a", "", models::positive, 0.75, "absorption"},
                                           models::Parameter{"K_m", "", models::positive, 1.0, "half saturation"},
                                           models::Parameter{"V_m", "", models::positive, 0.9, "largest elimination"}};
    template <class T>
    static models::State<T, 2> rhs(const T& /*t*/, const models::State<T, 2>& x, const models::Values<T, 3>& p) {
        constexpr double volume = 2.0;
        const T absorbed = p[0] * x[0];
        return {-absorbed, absorbed - p[2] / volume * x[1] / (p[1] + x[1])};
    }
};

static_assert(models::DescribedModel<BockLotkaVolterra>);
static_assert(models::DescribedModel<MichaelisMenten>);

}  // namespace

std::shared_ptr<const models::System> bock_system() {
    return std::make_shared<models::ModelSystem<BockLotkaVolterra>>();
}

std::shared_ptr<const models::System> michaelis_menten_system() {
    return std::make_shared<models::ModelSystem<MichaelisMenten>>();
}

}  // namespace orbid::tests
