#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "models/system/kernel.hpp"
#include "models/trajectories/odeint/odeint_solution.hpp"

namespace orbid::models {

/// Crossings of a plane in one direction by a solution of an autonomous model:
///
///     g(x) = direction (normal . x - offset)   rises through 0, or through the same after full turns of an angle
///
/// as SectionCrossing has them. The solution takes the steps that it would take without a section; crossings are
/// located on the interpolant of the step that passes them.
class OdeintSection {
public:
    struct Crossing {
        double time;
        std::vector<double> y;  ///< layout of VariationalEquations, its derivatives at a fixed time
        std::vector<double> f;  ///< x' there
    };

    /// A start on the plane is no crossing, nor is one that rounding has put a little below it. All must outlive this.
    OdeintSection(const Kernel& kernel, const FlowStart& start, const SectionPlane& plane, OdeintSolution& solution);

    /// The next crossing, not later than `latest`; otherwise status() says why there is none.
    [[nodiscard]] std::optional<Crossing> next(double latest);
    /// ok while crossings are found; then no_crossing, grazing, or what ended the solution.
    [[nodiscard]] FlowStatus status() const { return status_; }

private:
    /// Where the solution is, as far as the plane is concerned.
    struct View {
        double s = 0.0, g = 0.0;
        double slope = 0.0;  ///< dg/ds
        double terms = 0.0;  ///< sum of the terms of g without their signs: what rounding is relative to
    };

    [[nodiscard]] View look(const std::vector<double>& y, double s);
    [[nodiscard]] View view_at(double s) { return look(solution_.at(s), s); }
    void search(const View& a, const View& b);
    void search_rise(const View& a, const View& b);
    [[nodiscard]] View turning_point(const View& a, const View& b);
    void locate(View below, View above, double level);

    const Kernel& kernel_;
    FlowStart start_;
    SectionPlane plane_;
    OdeintSolution& solution_;
    double turn_;  ///< change of g that leads from the plane to itself, infinity without angles
    View end_;
    bool started_ = false;
    double rounding_ = 0.0;  ///< of g in this step: 45 roundings of the terms that it is the sum of
    std::vector<double> f_;
    std::vector<Crossing> found_;  ///< in the present step, in time
    FlowStatus status_ = FlowStatus::ok;
};

}  // namespace orbid::models
