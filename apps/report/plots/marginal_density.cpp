#include "apps/report/plots/marginal_density.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "apps/report/plots/catalog_plots.hpp"
#include "estimator/exploration/log_density_spline.hpp"

namespace orbid::apps {

MarginalDensity marginal_density(const nlohmann::ordered_json& list) {
    std::vector<std::array<double, 3>> points;
    for (const nlohmann::ordered_json& point : list) {
        const std::array<double, 3> one{catalog::number(point, "coordinate"), catalog::number(point, "value"),
                                        catalog::number(point, "log_density")};
        if (std::isfinite(one[0]) && std::isfinite(one[1]) && std::isfinite(one[2])) points.push_back(one);
    }
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end(), [](const auto& a, const auto& b) { return a[0] == b[0]; }),
                 points.end());
    MarginalDensity curve;
    if (points.size() < 3) return curve;
    std::vector<double> u;
    std::vector<double> logs;
    for (const auto& point : points) {
        u.push_back(point[0]);
        logs.push_back(point[2]);
    }
    const estimator::LogDensitySpline spline(u, logs);
    const auto slope = [&](std::size_t k) {
        const std::size_t before = k > 0 ? k - 1 : k;
        const std::size_t after = std::min(k + 1, points.size() - 1);
        return (points[after][1] - points[before][1]) / (u[after] - u[before]);
    };
    constexpr int pieces = 8;
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
        const double step = u[k + 1] - u[k];
        for (int piece = 0; piece < pieces; ++piece) {
            const double t = static_cast<double>(piece) / pieces;
            // Hermite's cubic and its derivative.
            const double rise = points[k + 1][1] - points[k][1];
            const double first = slope(k) * step;
            const double last = slope(k + 1) * step;
            const double bend = 3.0 * rise - 2.0 * first - last;
            const double twist = first + last - 2.0 * rise;
            const double derivative = (first + t * (2.0 * bend + 3.0 * t * twist)) / step;
            curve.x.push_back(points[k][1] + t * (first + t * (bend + t * twist)));
            curve.y.push_back(std::exp(spline.log_density(u[k] + t * step)) / std::abs(derivative));
        }
    }
    return curve;
}

}  // namespace orbid::apps
