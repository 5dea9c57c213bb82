#pragma once

#include <array>
#include <vector>

/// The peer of flow_bench, compiled for this machine in a file that knows no Eigen: what a user of Boost.Odeint writes
/// for the pendulums, and one period of the same in long double.
namespace orbid::bench {

enum class Pendulum { driven, parametric };
enum class Method { rkf78, dopri5 };

using Point = std::array<double, 2>;

/// Images of points one period after phase 0, with error-controlled steps of one tolerance, relative and absolute; the
/// first step is a fortieth of the period. A point that takes more than `most_steps` is left where it was then: at the
/// jumps of dry friction the steps of a controller that knows nothing of them may shrink without end.
///
/// @param k1         dry friction of the parametric pendulum [N m], its other parameters as the model has them
/// @param abandoned  counts points that took too many steps
std::vector<Point> images_by_odeint(Pendulum pendulum, double k1, Method method, double tolerance,
                                    const std::vector<Point>& points, std::size_t& abandoned,
                                    std::size_t most_steps = 20000);

/// The same to 17 digits, on all cores.
std::vector<std::array<long double, 2>> exact_images(Pendulum pendulum, double k1, const std::vector<Point>& points);

}  // namespace orbid::bench
