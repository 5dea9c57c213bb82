// The nonlinear regression problems of the NIST Statistical Reference Datasets, https://www.itl.nist.gov/div898/strd,
// files in tests/reference/nist: certified to 11 digits. Every parameter is on the linear scale, without bounds or
// priors; derivatives are exact, by a dual number of the test's own.

#include <array>
#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

#include "estimator/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/function_residual.hpp"

namespace orbid::tests {

namespace {

constexpr int most = 7;

/// Value and gradient with respect to the parameters.
struct Dual {
    double v = 0.0;
    Eigen::Matrix<double, most, 1> d = Eigen::Matrix<double, most, 1>::Zero();
    Dual(double value) : v(value) {}  // NOLINT: constants mix with duals
    Dual(double value, const Eigen::Matrix<double, most, 1>& gradient) : v(value), d(gradient) {}
};
Dual operator+(const Dual& a, const Dual& b) {
    return {a.v + b.v, a.d + b.d};
}
Dual operator-(const Dual& a, const Dual& b) {
    return {a.v - b.v, a.d - b.d};
}
Dual operator-(const Dual& a) {
    return {-a.v, -a.d};
}
Dual operator*(const Dual& a, const Dual& b) {
    return {a.v * b.v, a.d * b.v + b.d * a.v};
}
Dual operator/(const Dual& a, const Dual& b) {
    return {a.v / b.v, a.d / b.v - b.d * (a.v / (b.v * b.v))};
}
Dual exp(const Dual& a) {
    return {std::exp(a.v), a.d * std::exp(a.v)};
}
Dual log(const Dual& a) {
    return {std::log(a.v), a.d / a.v};
}
Dual pow(const Dual& a, const Dual& b) {
    return exp(b * log(a));
}

using Parameters = std::vector<Dual>;
using Model = Dual (*)(const Parameters& b, double x);

struct NistFile {
    std::vector<std::array<double, 2>> starts;
    std::vector<double> value;
    std::vector<double> sd;
    double residual_sd = 0.0;
    std::vector<double> x;
    std::vector<double> y;
};

NistFile read(const std::string& name) {
    std::ifstream file(std::string(ORBID_SOURCE_DIR) + "/tests/reference/nist/" + name + ".dat");
    REQUIRE(file.good());
    NistFile result;
    std::string line;
    bool data = false;
    for (int number = 1; std::getline(file, line); ++number) {
        std::istringstream text(line);
        if (const auto equals = line.find("="); number > 40 && equals != std::string::npos && line.find("  b") == 0) {
            std::istringstream numbers(line.substr(equals + 1));
            std::array<double, 2> start{};
            double value = 0.0;
            double sd = 0.0;
            numbers >> start[0] >> start[1] >> value >> sd;
            result.starts.push_back(start);
            result.value.push_back(value);
            result.sd.push_back(sd);
        } else if (line.find("Residual Standard Deviation:") == 0) {
            std::istringstream(line.substr(28)) >> result.residual_sd;
        } else if (data) {
            double y = 0.0;
            double x = 0.0;
            if (text >> y >> x) {
                result.y.push_back(y);
                result.x.push_back(x);
            }
        } else if (number > 50 && line.find("Data:") == 0) {
            data = true;
        }
    }
    REQUIRE(result.value.size() >= 2);
    REQUIRE(result.x.size() > result.value.size());
    return result;
}

struct Problem {
    const char* name;
    Model model;
    std::array<bool, 2> feasible;  ///< starts from which the certified minimum is reached
};

Dual rational(const Parameters& b, double x) {
    return (b[0] + b[1] * x + b[2] * (x * x) + b[3] * (x * x * x)) /
           (Dual(1.0) + b[4] * x + b[5] * (x * x) + b[6] * (x * x * x));
}

const std::vector<Problem>& problems() {
    static const std::vector<Problem> all{
        {"Misra1a", [](const Parameters& b, double x) { return b[0] * (Dual(1.0) - exp(-b[1] * x)); }, {true, true}},
        {"Chwirut2", [](const Parameters& b, double x) { return exp(-b[0] * x) / (b[1] + b[2] * x); }, {true, true}},
        {"Lanczos3",
         [](const Parameters& b, double x) {
             return b[0] * exp(-b[1] * x) + b[2] * exp(-b[3] * x) + b[4] * exp(-b[5] * x);
         },
         {true, true}},
        {"Eckerle4",
         [](const Parameters& b, double x) {
             const Dual t = (Dual(x) - b[2]) / b[1];
             return b[0] / b[1] * exp(Dual(-0.5) * t * t);
         },
         {true, true}},
        {"MGH09",
         [](const Parameters& b, double x) { return b[0] * (b[1] * x + x * x) / (b[2] * x + (x * x) + b[3]); },
         {true, true}},
        {"MGH10", [](const Parameters& b, double x) { return b[0] * exp(b[1] / (b[2] + x)); }, {true, true}},
        // Start 1 ends where b4 = b5 and b2, b3 cannot be told apart: reported as singular, not as converged.
        {"MGH17",
         [](const Parameters& b, double x) { return b[0] + b[1] * exp(-b[3] * x) + b[2] * exp(-b[4] * x); },
         {false, true}},
        {"Thurber", rational, {true, true}},
        {"BoxBOD", [](const Parameters& b, double x) { return b[0] * (Dual(1.0) - exp(-b[1] * x)); }, {true, true}},
        {"Rat42",
         [](const Parameters& b, double x) { return b[0] / (Dual(1.0) + exp(b[1] - b[2] * x)); },
         {true, true}},
        {"Rat43",
         [](const Parameters& b, double x) { return b[0] / pow(Dual(1.0) + exp(b[1] - b[2] * x), Dual(1.0) / b[3]); },
         {true, true}},
        {"Hahn1", rational, {true, true}},
        {"Bennett5",
         [](const Parameters& b, double x) { return b[0] * pow(b[1] + x, Dual(-1.0) / b[2]); },
         {true, true}},
    };
    return all;
}

FunctionResidual residual_of(const NistFile& file, Model model) {
    FunctionResidual residual;
    residual.add_group(group("y"));
    const auto n = static_cast<Eigen::Index>(file.y.size());
    residual.add_block(layout("data", n), [file, model, n](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        Parameters b;
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            b.emplace_back(theta[i], Eigen::Matrix<double, most, 1>::Unit(i));
        estimator::BlockValue value;
        value.e.resize(n);
        value.e_theta.resize(n, theta.size());
        value.e_z.resize(n, 0);
        for (Eigen::Index i = 0; i < n; ++i) {
            const Dual y = model(b, file.x[static_cast<std::size_t>(i)]);
            value.e[i] = file.y[static_cast<std::size_t>(i)] - y.v;
            value.e_theta.row(i) = -y.d.head(theta.size()).transpose();
        }
        return value;
    });
    return residual;
}

}  // namespace

TEST_CASE("NIST regression problems from both starts", "[estimator][reference]") {
    for (const Problem& problem : problems()) {
        const NistFile file = read(problem.name);
        for (std::size_t start = 0; start < 2; ++start) {
            if (!problem.feasible[start]) continue;
            CAPTURE(problem.name, start + 1);
            FunctionResidual residual = residual_of(file, problem.model);
            std::vector<estimator::FreeParameter> parameters;
            for (std::size_t i = 0; i < file.value.size(); ++i) {
                parameters.push_back(free_parameter("b" + std::to_string(i + 1), file.starts[i][start]));
                parameters.back().typical_size = std::abs(file.starts[i][start]);
            }
            // b1 / b2 exp(-((x - b3) / b2)^2 / 2) does not change with the signs of b1 and b2.
            const bool either_sign = std::string(problem.name) == "Eckerle4";
            estimator::EstimateOptions options;
            options.maximum_iterations = 5000;  // narrow curved valleys from far starts
            const estimator::Estimate result = estimator::estimate(parameters, {&residual}, {}, options);
            CAPTURE(result.message, result.iterations, result.evaluations);
            CHECK(result.status == estimator::EstimateStatus::converged);
            for (std::size_t i = 0; i < file.value.size(); ++i) {
                CAPTURE(i);
                // Certified to 11 digits.
                const double value = result.parameters[i].value;
                CHECK_THAT(either_sign ? std::abs(value) : value, WithinRel(file.value[i], 1e-8));
                CHECK_THAT(result.parameters[i].sd, WithinRel(file.sd[i], 1e-7));
            }
            CHECK_THAT(result.scales[0].value, WithinRel(file.residual_sd, 1e-9));
        }
    }
}

}  // namespace orbid::tests
