#pragma once

// Problems 1 to 19 of J.J. More, B.S. Garbow, K.E. Hillstrom, Testing unconstrained optimization software, ACM TOMS
// 7:17-41 (1981), with the bounds of D.M. Gay (1984), shared by tests and benchmarks. Starts, bounds and minima are in
// tests/reference/mgh/mgh.json.

#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "tests/estimator/minimisation/least_squares_problem.hpp"

namespace orbid::tests {

struct MghProblem {
    int number = 0;
    std::string name;
    std::vector<double> start;
    double minimum = 0.0;  ///< of the sum of squares
    bool bounded = false;  ///< the problem also exists with bounds:
    std::vector<double> lower;
    std::vector<double> upper;
    double bounded_minimum = 0.0;
    LeastSquares sum;
    LeastSquares bounded_sum;  ///< the same, but for problem 11: its bounded minimum is that of fewer residuals

    [[nodiscard]] double value(const std::vector<double>& x) const { return square(sum, x); }
    [[nodiscard]] double bounded_value(const std::vector<double>& x) const { return square(bounded_sum, x); }

private:
    static double square(const LeastSquares& problem, const std::vector<double>& x) {
        std::vector<double> e(static_cast<std::size_t>(problem.residuals));
        problem.values(x.data(), e.data());
        double result = 0.0;
        for (const double own : e)
            result += own * own;
        return result;
    }
};

/// Whether f is the minimum to the accuracy that counts as success.
inline bool reaches(double f, double minimum) {
    return std::abs(f - minimum) <= 1e-4 * (minimum > 0.0 ? minimum : 1.0);
}

namespace mgh {

template <int Parameters, class Write>
LeastSquares sum(int residuals, Write write) {
    return {Parameters, residuals, with_derivatives<Parameters>(write)};
}

inline constexpr std::array bard_y{0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39,
                                   0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39};
inline LeastSquares bard() {
    return sum<3>(15, [](auto* x, auto put) {
        for (std::size_t i = 0; i < 15; ++i) {
            const double u = static_cast<double>(i + 1);
            const double v = 16.0 - u;
            put(i, bard_y[i] - (x[0] + u / (v * x[1] + std::min(u, v) * x[2])));
        }
    });
}

inline constexpr std::array gaussian_y{0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989,
                                       0.3521, 0.2420, 0.1295, 0.0540, 0.0175, 0.0044, 0.0009};
inline LeastSquares gaussian() {
    return sum<3>(15, [](auto* x, auto put) {
        using std::exp;
        for (std::size_t i = 0; i < 15; ++i) {
            const auto t = 0.5 * (7.0 - static_cast<double>(i)) - x[2];
            put(i, x[0] * exp(-0.5 * x[1] * (t * t)) - gaussian_y[i]);
        }
    });
}

inline constexpr std::array meyer_y{34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0,
                                    8261.0,  7030.0,  6005.0,  5147.0,  4427.0,  3820.0,  3307.0,  2872.0};
inline LeastSquares meyer() {
    return sum<3>(16, [](auto* x, auto put) {
        using std::exp;
        for (std::size_t i = 0; i < 16; ++i)
            put(i, x[0] * exp(x[1] / (50.0 + 5.0 * static_cast<double>(i) + x[2])) - meyer_y[i]);
    });
}

/// |y - x2|^x3 with y_i = 25 + (-50 ln t_i)^(2/3); the paper's printed m i in the place of the minus is a misprint.
inline LeastSquares gulf(std::size_t residuals) {
    return sum<3>(static_cast<int>(residuals), [residuals](auto* x, auto put) {
        using std::exp;
        using std::pow;
        for (std::size_t i = 0; i < residuals; ++i) {
            const double t = static_cast<double>(i + 1) / 100.0;
            const double y = 25.0 + std::pow(-50.0 * std::log(t), 2.0 / 3.0);
            auto distance = y - x[1];
            if (value_of(distance) < 0.0) distance = -distance;
            put(i, exp(-pow(distance, x[2]) / x[0]) - t);
        }
    });
}

inline constexpr std::array kowalik_u{4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625};
inline constexpr std::array kowalik_y{0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627,
                                      0.0456, 0.0342, 0.0323, 0.0235, 0.0246};
inline LeastSquares kowalik_osborne() {
    return sum<4>(11, [](auto* x, auto put) {
        for (std::size_t i = 0; i < 11; ++i)
            put(i, kowalik_y[i] - x[0] * (kowalik_u[i] * kowalik_u[i] + kowalik_u[i] * x[1]) /
                                      (kowalik_u[i] * kowalik_u[i] + kowalik_u[i] * x[2] + x[3]));
    });
}

inline constexpr std::array osborne_1_y{0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751,
                                        0.718, 0.685, 0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490,
                                        0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406};
inline LeastSquares osborne_1() {
    return sum<5>(33, [](auto* x, auto put) {
        using std::exp;
        for (std::size_t i = 0; i < 33; ++i) {
            const double t = 10.0 * static_cast<double>(i);
            put(i, osborne_1_y[i] - (x[0] + x[1] * exp(-t * x[3]) + x[2] * exp(-t * x[4])));
        }
    });
}

inline constexpr std::array osborne_2_y{1.366, 1.191, 1.112, 1.013, 0.991, 0.885, 0.831, 0.847, 0.786, 0.725, 0.746,
                                        0.679, 0.608, 0.655, 0.616, 0.606, 0.602, 0.626, 0.651, 0.724, 0.649, 0.649,
                                        0.694, 0.644, 0.624, 0.661, 0.612, 0.558, 0.533, 0.495, 0.500, 0.423, 0.395,
                                        0.375, 0.372, 0.391, 0.396, 0.405, 0.428, 0.429, 0.523, 0.562, 0.607, 0.653,
                                        0.672, 0.708, 0.633, 0.668, 0.645, 0.632, 0.591, 0.559, 0.597, 0.625, 0.739,
                                        0.710, 0.729, 0.720, 0.636, 0.581, 0.428, 0.292, 0.162, 0.098, 0.054};
inline LeastSquares osborne_2() {
    return sum<11>(65, [](auto* x, auto put) {
        using std::exp;
        for (std::size_t i = 0; i < 65; ++i) {
            const double t = 0.1 * static_cast<double>(i);
            const auto a = t - x[8];
            const auto b = t - x[9];
            const auto c = t - x[10];
            put(i, osborne_2_y[i] - (x[0] * exp(-t * x[4]) + x[1] * exp(-(a * a) * x[5]) + x[2] * exp(-(b * b) * x[6]) +
                                     x[3] * exp(-(c * c) * x[7])));
        }
    });
}

inline LeastSquares sum_of(int number) {
    switch (number) {
        case 1:
            return sum<2>(2, [](auto* x, auto put) {
                put(0, 10.0 * (x[1] - x[0] * x[0]));
                put(1, 1.0 - x[0]);
            });
        case 2:
            return sum<2>(2, [](auto* x, auto put) {
                put(0, -13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1]);
                put(1, -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1]);
            });
        case 3:
            return sum<2>(2, [](auto* x, auto put) {
                using std::exp;
                put(0, 1e4 * x[0] * x[1] - 1.0);
                put(1, exp(-x[0]) + exp(-x[1]) - 1.0001);
            });
        case 4:
            return sum<2>(3, [](auto* x, auto put) {
                put(0, x[0] - 1e6);
                put(1, x[1] - 2e-6);
                put(2, x[0] * x[1] - 2.0);
            });
        case 5:
            return sum<2>(3, [](auto* x, auto put) {
                put(0, 1.5 - x[0] * (1.0 - x[1]));
                put(1, 2.25 - x[0] * (1.0 - x[1] * x[1]));
                put(2, 2.625 - x[0] * (1.0 - x[1] * x[1] * x[1]));
            });
        case 6:
            return sum<2>(10, [](auto* x, auto put) {
                using std::exp;
                for (std::size_t i = 0; i < 10; ++i) {
                    const double k = static_cast<double>(i + 1);
                    put(i, 2.0 + 2.0 * k - (exp(k * x[0]) + exp(k * x[1])));
                }
            });
        case 7:
            return sum<3>(3, [](auto* x, auto put) {
                using std::atan;
                using std::sqrt;
                const auto turns = atan(x[1] / x[0]) / (2.0 * std::numbers::pi) + (value_of(x[0]) < 0.0 ? 0.5 : 0.0);
                put(0, 10.0 * (x[2] - 10.0 * turns));
                put(1, 10.0 * (sqrt(x[0] * x[0] + x[1] * x[1]) - 1.0));
                put(2, x[2]);
            });
        case 8:
            return bard();
        case 9:
            return gaussian();
        case 10:
            return meyer();
        case 11:
            return gulf(100);
        case 12:
            return sum<3>(3, [](auto* x, auto put) {
                using std::exp;
                for (std::size_t i = 0; i < 3; ++i) {
                    const double t = 0.1 * static_cast<double>(i + 1);
                    put(i, exp(-t * x[0]) - exp(-t * x[1]) - x[2] * (std::exp(-t) - std::exp(-10.0 * t)));
                }
            });
        case 13:
            return sum<4>(4, [](auto* x, auto put) {
                const auto middle = x[1] - 2.0 * x[2];
                const auto outer = x[0] - x[3];
                put(0, x[0] + 10.0 * x[1]);
                put(1, std::sqrt(5.0) * (x[2] - x[3]));
                put(2, middle * middle);
                put(3, std::sqrt(10.0) * (outer * outer));
            });
        case 14:
            return sum<4>(6, [](auto* x, auto put) {
                put(0, 10.0 * (x[1] - x[0] * x[0]));
                put(1, 1.0 - x[0]);
                put(2, std::sqrt(90.0) * (x[3] - x[2] * x[2]));
                put(3, 1.0 - x[2]);
                put(4, std::sqrt(10.0) * (x[1] + x[3] - 2.0));
                put(5, (x[1] - x[3]) / std::sqrt(10.0));
            });
        case 15:
            return kowalik_osborne();
        case 16:
            return sum<4>(20, [](auto* x, auto put) {
                for (std::size_t i = 0; i < 20; ++i) {
                    const double t = static_cast<double>(i + 1) / 5.0;
                    const auto a = x[0] + t * x[1] - std::exp(t);
                    const auto b = x[2] + std::sin(t) * x[3] - std::cos(t);
                    put(i, a * a + b * b);
                }
            });
        case 17:
            return osborne_1();
        case 18:
            return sum<6>(13, [](auto* x, auto put) {
                using std::exp;
                for (std::size_t i = 0; i < 13; ++i) {
                    const double t = 0.1 * static_cast<double>(i + 1);
                    const double y = std::exp(-t) - 5.0 * std::exp(-10.0 * t) + 3.0 * std::exp(-4.0 * t);
                    put(i, x[2] * exp(-t * x[0]) - x[3] * exp(-t * x[1]) + x[5] * exp(-t * x[4]) - y);
                }
            });
        case 19:
            return osborne_2();
        default:
            throw std::invalid_argument("problem " + std::to_string(number) + " is not one of 1 to 19");
    }
}

}  // namespace mgh

/// All problems of the table `path`. @throws std::runtime_error when it cannot be read or its sizes differ.
inline std::vector<MghProblem> read_mgh_problems(const std::string& path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error(path + ": cannot be read");
    std::vector<MghProblem> problems;
    const nlohmann::json table = nlohmann::json::parse(file);
    for (const nlohmann::json& entry : table.at("problems")) {
        MghProblem problem;
        problem.number = entry.at("number");
        problem.name = entry.at("name");
        problem.start = entry.at("start").get<std::vector<double>>();
        problem.minimum = entry.at("minimum");
        problem.sum = mgh::sum_of(problem.number);
        if (problem.sum.parameters != entry.at("parameters").get<int>() ||
            problem.sum.residuals != entry.at("residuals").get<int>())
            throw std::runtime_error(path + ": " + problem.name + " has other sizes");
        if (entry.contains("bounded")) {
            problem.bounded = true;
            problem.lower = entry["bounded"].at("lower").get<std::vector<double>>();
            problem.upper = entry["bounded"].at("upper").get<std::vector<double>>();
            problem.bounded_minimum = entry["bounded"].at("minimum");
            problem.bounded_sum = problem.sum;
            if (entry["bounded"].contains("residuals"))
                problem.bounded_sum = mgh::gulf(entry["bounded"]["residuals"].get<std::size_t>());
        }
        problems.push_back(std::move(problem));
    }
    return problems;
}

}  // namespace orbid::tests
