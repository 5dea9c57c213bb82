#pragma once

// The 27 nonlinear regression problems of the NIST Statistical Reference Datasets, shared by tests and benchmarks:
// models as printed in the files of tests/reference/nist.

#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/estimator/minimisation/least_squares_problem.hpp"

namespace orbid::tests {

struct NistProblem {
    std::string name;
    /// Parameters whose sign the model does not see (widths of peaks, or amplitude and width together).
    std::vector<bool> either_sign;
    std::array<std::vector<double>, 2> starts;
    std::vector<double> value;  ///< certified
    std::vector<double> sd;     ///< certified
    double residual_sd = 0.0;   ///< certified
    LeastSquares sum;

    /// Correct digits of the worst parameter, at most 11 (the certified ones): -log10 of the relative error.
    [[nodiscard]] double log_relative_error(const std::vector<double>& estimate) const {
        return digits(estimate, value, either_sign);
    }
    [[nodiscard]] double log_relative_error_of_sds(const std::vector<double>& sds) const { return digits(sds, sd, {}); }

private:
    static double digits(const std::vector<double>& found, const std::vector<double>& certified,
                         const std::vector<bool>& signless) {
        double least = 11.0;
        for (std::size_t i = 0; i < certified.size(); ++i) {
            const bool free_sign = i < signless.size() && signless[i];
            const double x = free_sign ? std::abs(found[i]) : found[i];
            const double error = std::abs(x - certified[i]) / std::abs(certified[i]);
            const double own = error > 0.0 ? -std::log10(error) : 11.0;
            if (!(own >= least)) least = own;  // also nan
        }
        return least;
    }
};

namespace nist {

struct Data {
    std::vector<double> y;
    std::vector<std::array<double, 2>> x;
};

/// Residuals y - model(b, x1, x2).
template <int Parameters, class Model>
LeastSquares regression(const Data& data, Model model) {
    return {Parameters, static_cast<int>(data.y.size()), with_derivatives<Parameters>([data, model](auto* b, auto put) {
                for (std::size_t i = 0; i < data.y.size(); ++i)
                    put(i, data.y[i] - model(b, data.x[i][0], data.x[i][1]));
            })};
}

inline LeastSquares sum_of(const std::string& name, Data data) {
    using std::atan;
    using std::cos;
    using std::exp;
    using std::pow;
    using std::sin;
    const std::string family = name.substr(0, name.find_first_of("0123456789"));
    if (name == "Misra1a" || name == "BoxBOD")
        return regression<2>(data, [](auto* b, double x, double) { return b[0] * (1.0 - exp(-b[1] * x)); });
    if (name == "Misra1b")
        return regression<2>(data, [](auto* b, double x, double) {
            const auto t = 1.0 + b[1] * (0.5 * x);
            return b[0] * (1.0 - 1.0 / (t * t));
        });
    if (name == "Misra1c")
        return regression<2>(data, [](auto* b, double x, double) {
            using std::sqrt;
            return b[0] * (1.0 - 1.0 / sqrt(1.0 + b[1] * (2.0 * x)));
        });
    if (name == "Misra1d")
        return regression<2>(data, [](auto* b, double x, double) { return b[0] * b[1] * x / (1.0 + b[1] * x); });
    if (family == "Chwirut")
        return regression<3>(data, [](auto* b, double x, double) { return exp(-b[0] * x) / (b[1] + b[2] * x); });
    if (family == "Lanczos")
        // Term by term from the reading, so that the numbers that are rounded get smaller: the residuals of Lanczos1
        // are a few hundred roundings of a reading.
        return {6, static_cast<int>(data.y.size()), with_derivatives<6>([data](auto* b, auto put) {
                    for (std::size_t i = 0; i < data.y.size(); ++i) {
                        const double x = data.x[i][0];
                        put(i, ((data.y[i] - b[0] * exp(-b[1] * x)) - b[2] * exp(-b[3] * x)) - b[4] * exp(-b[5] * x));
                    }
                })};
    if (family == "Gauss")
        return regression<8>(data, [](auto* b, double x, double) {
            const auto s = (x - b[3]) / b[4];
            const auto t = (x - b[6]) / b[7];
            return b[0] * exp(-b[1] * x) + b[2] * exp(-(s * s)) + b[5] * exp(-(t * t));
        });
    if (name == "DanWood") return regression<2>(data, [](auto* b, double x, double) { return b[0] * pow(x, b[1]); });
    if (name == "Kirby2")
        return regression<5>(data, [](auto* b, double x, double) {
            return (b[0] + b[1] * x + b[2] * (x * x)) / (1.0 + b[3] * x + b[4] * (x * x));
        });
    if (name == "Hahn1" || name == "Thurber")
        return regression<7>(data, [](auto* b, double x, double) {
            return (b[0] + b[1] * x + b[2] * (x * x) + b[3] * (x * x * x)) /
                   (1.0 + b[4] * x + b[5] * (x * x) + b[6] * (x * x * x));
        });
    if (name == "Nelson") {
        for (double& y : data.y)
            y = std::log(y);
        return regression<3>(data, [](auto* b, double x1, double x2) { return b[0] - b[1] * x1 * exp(-b[2] * x2); });
    }
    if (name == "MGH17")
        return regression<5>(
            data, [](auto* b, double x, double) { return b[0] + b[1] * exp(-b[3] * x) + b[2] * exp(-b[4] * x); });
    if (name == "Roszman1")
        return regression<4>(data, [](auto* b, double x, double) {
            return b[0] - b[1] * x - atan(b[2] / (x - b[3])) / std::numbers::pi;
        });
    if (name == "ENSO")
        return regression<9>(data, [](auto* b, double x, double) {
            const double year = 2.0 * std::numbers::pi * x / 12.0;
            const auto first = 2.0 * std::numbers::pi * x / b[3];
            const auto second = 2.0 * std::numbers::pi * x / b[6];
            return b[0] + b[1] * std::cos(year) + b[2] * std::sin(year) + b[4] * cos(first) + b[5] * sin(first) +
                   b[7] * cos(second) + b[8] * sin(second);
        });
    if (name == "MGH09")
        return regression<4>(
            data, [](auto* b, double x, double) { return b[0] * (x * x + b[1] * x) / (x * x + b[2] * x + b[3]); });
    if (name == "MGH10")
        return regression<3>(data, [](auto* b, double x, double) { return b[0] * exp(b[1] / (x + b[2])); });
    if (name == "Rat42")
        return regression<3>(data, [](auto* b, double x, double) { return b[0] / (1.0 + exp(b[1] - b[2] * x)); });
    if (name == "Rat43")
        return regression<4>(
            data, [](auto* b, double x, double) { return b[0] / pow(1.0 + exp(b[1] - b[2] * x), 1.0 / b[3]); });
    if (name == "Eckerle4")
        return regression<3>(data, [](auto* b, double x, double) {
            const auto t = (x - b[2]) / b[1];
            return b[0] / b[1] * exp(-0.5 * (t * t));
        });
    if (name == "Bennett5")
        return regression<3>(data, [](auto* b, double x, double) { return b[0] * pow(b[1] + x, -1.0 / b[2]); });
    throw std::invalid_argument("no NIST problem is called " + name);
}

}  // namespace nist

/// In NIST's order of difficulty: lower, average, higher.
inline const std::vector<std::string>& nist_names() {
    static const std::vector<std::string> names{
        "Misra1a", "Chwirut2", "Chwirut1", "Lanczos3", "Gauss1",   "Gauss2", "DanWood",  "Misra1b", "Kirby2",
        "Hahn1",   "Nelson",   "MGH17",    "Lanczos1", "Lanczos2", "Gauss3", "Misra1c",  "Misra1d", "Roszman1",
        "ENSO",    "MGH09",    "Thurber",  "BoxBOD",   "Rat42",    "MGH10",  "Eckerle4", "Rat43",   "Bennett5"};
    return names;
}

/// Reads `folder`/`name`.dat. @throws std::runtime_error when it cannot be read.
inline NistProblem read_nist_problem(const std::string& folder, const std::string& name) {
    NistProblem problem;
    problem.name = name;
    std::ifstream file(folder + "/" + name + ".dat");
    nist::Data data;
    std::string line;
    bool in_data = false;
    for (int number = 1; std::getline(file, line); ++number) {
        std::istringstream text(line);
        const auto equals = line.find('=');
        if (number > 40 && equals != std::string::npos && line.find("  b") == 0) {
            std::istringstream numbers(line.substr(equals + 1));
            double first = 0.0;
            double second = 0.0;
            double value = 0.0;
            double sd = 0.0;
            numbers >> first >> second >> value >> sd;
            problem.starts[0].push_back(first);
            problem.starts[1].push_back(second);
            problem.value.push_back(value);
            problem.sd.push_back(sd);
        } else if (line.find("Residual Standard Deviation:") == 0) {
            std::istringstream(line.substr(28)) >> problem.residual_sd;
        } else if (in_data) {
            double y = 0.0;
            std::array<double, 2> x{};
            if (text >> y >> x[0]) {
                text >> x[1];
                data.y.push_back(y);
                data.x.push_back(x);
            }
        } else if (number > 50 && line.find("Data:") == 0) {
            in_data = true;
        }
    }
    if (problem.value.size() < 2 || data.y.size() <= problem.value.size())
        throw std::runtime_error(folder + "/" + name + ".dat: cannot be read");
    problem.sum = nist::sum_of(name, std::move(data));
    if (problem.value.size() != static_cast<std::size_t>(problem.sum.parameters))
        throw std::runtime_error(folder + "/" + name + ".dat: wrong number of parameters");
    problem.either_sign.assign(problem.value.size(), false);
    if (name == "Eckerle4") problem.either_sign[0] = problem.either_sign[1] = true;
    if (name.find("Gauss") == 0) problem.either_sign[4] = problem.either_sign[7] = true;
    return problem;
}

}  // namespace orbid::tests
