#include "periodic/branches/branch_curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "periodic/discretisation/closing_error.hpp"
#include "periodic/discretisation/cyclic_system.hpp"
#include "periodic/discretisation/shooting_steps.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/orbit_report.hpp"
#include "periodic/stability/floquet.hpp"

namespace orbid::periodic {
namespace {

using Complex = std::complex<double>;

/// A Newton step below this that is not followed by one ten times shorter consists of rounding, see newton().
constexpr double noise_level = 1e-7;

/// Newton's steps that shrink by less than this are not about to converge: Newton's theorem asks for 1/2.
constexpr double curve_contraction = 0.7;

/// Steps of this length move no multiplier in its first eleven digits.
constexpr double rounding_step = 1e-12;

/// Multipliers of an orbit without the trivial one (nearest to 1).
void find_multipliers(CurvePoint& point, bool autonomous) {
    point.multipliers = floquet_multipliers(condensed_factors(point.jacobians));
    point.trivial = std::numeric_limits<double>::quiet_NaN();
    if (!autonomous || point.multipliers.empty()) return;
    point.trivial = take_trivial(point.multipliers);
}

ClosingError closing_at(const OrbitCurve& curve, const VectorXd& y, std::span<const Index> free) {
    const CurveSetting& setting = curve.setting();
    const VectorXd theta = setting.theta_at(y(y.size() - 1));
    return closing_error(FlowSteps(setting.system, theta, curve.mesh(), setting.solver.flow), curve.nodes(y),
                         curve.time(y), curve.turns(), free);
}

/// The nodes of y, each in the place of the one before.
VectorXd next_nodes(const VectorXd& y, Index n, Index count) {
    VectorXd next(n * count);
    for (Index j = 0; j < count; ++j)
        next.segment(n * j, n) = y.segment(n * ((j + 1) % count), n);
    return next;
}

/// Beside the columns of ln T and of the parameter the border has that of the unfolding, where a direction is locked.
CyclicSystem::Border border_below(const MatrixXd& rows, Index inner, Index own) {
    const Index k = rows.rows();
    CyclicSystem::Border border{MatrixXd::Zero(inner, k), rows.leftCols(inner), MatrixXd::Zero(k, k)};
    border.corner.leftCols(own) = rows.rightCols(own);
    return border;
}

/// Right-hand sides of Newton's step from y towards the plane through the guess, and of the tangent.
MatrixXd step_and_tangent(const OrbitCurve& curve, const ClosingError& closing, const MatrixXd& rows, const VectorXd& y,
                          const VectorXd& guess) {
    const Index inner = closing.error.size();
    MatrixXd right = MatrixXd::Zero(inner + rows.rows(), 2);
    right.col(0).head(inner) = closing.error.reshaped();
    VectorXd back = guess - y;
    back(back.size() - 1) /= curve.setting().range;
    right.col(0).tail(rows.rows()) = rows * back;
    if (const auto& phase = curve.phase())
        right(inner, 0) = (phase->offset - phase->normal.dot(y.head(phase->normal.size()))) / phase->normal.norm();
    right(right.rows() - 1, 1) = 1.0;
    return right;
}

/// What the last step knows of its point; `moves`: the step and the tangent.
CurvePoint curve_point(std::shared_ptr<const OrbitCurve> curve, ClosingError& closing, const MatrixXd& moves,
                       const MatrixXd& columns, double length) {
    CurvePoint point;
    point.tangent = moves.col(1) / curve->norm(moves.col(1));
    point.last_step = length;
    point.residual = closing.error.cwiseAbs().maxCoeff();
    point.sticking = closing.sticking;
    point.jacobians = std::move(closing.jacobians);
    point.columns = columns;
    find_multipliers(point, curve->autonomous());
    point.curve = std::move(curve);
    return point;
}

}  // namespace

VectorXd CurveSetting::theta_at(double value) const {
    VectorXd result = theta;
    result(parameter) = value;
    return result;
}

int CurvePoint::unstable() const {
    return static_cast<int>(std::count_if(multipliers.begin(), multipliers.end(),
                                          [](const Complex& multiplier) { return std::abs(multiplier) > 1.0; }));
}

OrbitCurve::OrbitCurve(const CurveSetting& setting, ShootingMesh mesh, MatrixXd turns, VectorXd scale,
                       std::optional<models::Section> phase, int period)
    : setting_(&setting),
      mesh_(std::move(mesh)),
      turns_(std::move(turns)),
      scale_(std::move(scale)),
      phase_(std::move(phase)),
      period_(period),
      n_(setting.system.dimension()),
      count_(static_cast<Index>(mesh_.segments.size())) {
    weights_.resize(n_ * count_ + (phase_ ? 2 : 1));
    for (Index j = 0; j < count_; ++j)
        weights_.segment(n_ * j, n_) =
            std::sqrt(mesh_.segments[static_cast<std::size_t>(j)].share) * scale_.cwiseInverse();
    weights_.tail(phase_ ? 2 : 1).setOnes();
    weights_(weights_.size() - 1) = 1.0 / setting.range;
}

std::vector<int> OrbitCurve::rotation() const {
    return total_rotation(turns_, angle_coordinates(setting_->system));
}

MatrixXd OrbitCurve::nodes(const VectorXd& y) const {
    return y.head(n_ * count_).reshaped(n_, count_);
}

double OrbitCurve::time(const VectorXd& y) const {
    if (autonomous()) return std::exp(y(n_ * count_));
    if (setting_->system.kind() == models::Kind::map) return static_cast<double>(mesh_.points.size());
    return static_cast<double>(mesh_.points.size()) *
           setting_->system.period(setting_->theta_at(y(y.size() - 1)), models::Clock::time);
}

VectorXd OrbitCurve::at_mesh(double parameter) const {
    VectorXd y(size());
    y.head(n_ * count_) = mesh_.nodes.reshaped();
    if (autonomous()) y(n_ * count_) = std::log(mesh_.time);
    y(y.size() - 1) = parameter;
    return y;
}

double OrbitCurve::product(const VectorXd& a, const VectorXd& b) const {
    return (weights_.array() * a.array()).matrix().dot((weights_.array() * b.array()).matrix());
}

double OrbitCurve::norm(const VectorXd& a) const {
    return (weights_.array() * a.array()).matrix().norm();
}

VectorXd OrbitCurve::parameter_direction() const {
    VectorXd direction = VectorXd::Zero(size());
    direction(size() - 1) = setting_->range;
    return direction;
}

ShootingMesh OrbitCurve::mesh_at(const VectorXd& y) const {
    ShootingMesh mesh = mesh_;
    mesh.nodes = nodes(y);
    mesh.time = time(y);
    if (autonomous())
        for (Segment& segment : mesh.segments)
            segment.duration = segment.share * mesh.time;
    return mesh;
}

MatrixXd OrbitCurve::rows_across(const std::vector<VectorXd>& directions) const {
    const Index first = autonomous() ? 1 : 0;
    MatrixXd rows = MatrixXd::Zero(first + static_cast<Index>(directions.size()), size());
    if (autonomous()) rows.row(0).head(n_) = phase_->normal.transpose() / phase_->normal.norm();
    for (std::size_t i = 0; i < directions.size(); ++i)
        rows.row(first + static_cast<Index>(i)) = weights_.array().square() * directions[i].array();
    rows.rightCols(1) *= setting_->range;
    return rows;
}

Correction OrbitCurve::corrected(const VectorXd& guess, const VectorXd& direction, double tolerance,
                                 int maximum_iterations, const VectorXd* locked) const {
    const Index inner = n_ * count_;
    const models::Domain domain = setting_->system.parameters()[static_cast<std::size_t>(setting_->parameter)].domain;
    std::vector<VectorXd> directions;
    if (locked != nullptr) directions.push_back(*locked);
    directions.push_back(direction / norm(direction));
    const MatrixXd rows = rows_across(directions);
    const Index own = size() - inner;  // ln T and the parameter
    CyclicSystem::Border border = border_below(rows, inner, own);
    // The null vector at the end of each segment: it is not orthogonal to what the equations miss at a branch point.
    if (locked != nullptr) border.columns.col(own) = next_nodes(*locked, n_, count_);
    const std::vector<Index> free{setting_->parameter};
    Correction result;
    VectorXd y = guess;
    double first = 0.0;
    double last = std::numeric_limits<double>::infinity();
    for (int iteration = 0; iteration < maximum_iterations; ++iteration) {
        result.status = OrbitStatus::not_simulated;
        if (!y.allFinite() || !models::contains(domain, y(y.size() - 1))) return result;
        ClosingError closing = closing_at(*this, y, free);
        if (!closing.simulated) return result;
        result.status = OrbitStatus::no_progress;

        border.columns.leftCols(own) << closing.by_ln_time, closing.parameters * setting_->range;
        const CyclicSystem matrix(closing.jacobians, border, scale_);
        // The tangent belongs to the same matrix as the step.
        MatrixXd right = step_and_tangent(*this, closing, rows, y, guess);
        if (locked != nullptr) right.col(0).head(inner) += result.unfolding * border.columns.col(own);
        const MatrixXd solution = matrix.solve(right);
        if (!solution.allFinite()) {
            result.status = OrbitStatus::singular;
            return result;
        }
        MatrixXd moves = solution.topRows(size());
        moves.bottomRows(1) *= setting_->range;
        if (locked != nullptr) result.unfolding += solution(size(), 0);
        const double length = norm(moves.col(0));
        if (iteration == 0) first = length;
        if (iteration == 1) result.contraction = length / first;
        const bool stagnates = last < noise_level && length > 0.1 * last;
        y += moves.col(0);
        if (length <= tolerance || stagnates) {
            result.point = curve_point(shared_from_this(), closing, moves, border.columns.leftCols(own), length);
            result.point.iterations = iteration + 1;
            result.distance = norm(y - guess);
            result.point.y = std::move(y);
            result.status = OrbitStatus::converged;
            return result;
        }
        if (iteration > 0 && !(length <= curve_contraction * last)) return result;
        last = length;
    }
    return result;
}

MatrixXd OrbitCurve::moves_across(const CurvePoint& point, std::span<const Index> free) const {
    const Index inner = n_ * count_;
    const Index own = size() - inner;
    std::vector<Index> all(free.begin(), free.end());
    all.push_back(setting_->parameter);
    const auto f = std::ssize(free);
    const ClosingError closing = closing_at(*this, point.y, all);
    if (!closing.simulated) return MatrixXd::Constant(size(), f + 1, std::numeric_limits<double>::quiet_NaN());
    const MatrixXd rows = rows_across({point.tangent});
    CyclicSystem::Border border = border_below(rows, inner, own);
    border.columns << closing.by_ln_time, closing.parameters.rightCols(1) * setting_->range;
    MatrixXd right = MatrixXd::Zero(size(), f + 1);
    right.topLeftCorner(inner, f) = closing.parameters.leftCols(f);
    right(size() - 1, f) = 1.0;
    MatrixXd moves = CyclicSystem(closing.jacobians, border, scale_).solve(right);
    moves.bottomRows(1) *= setting_->range;
    moves.col(f) /= norm(moves.col(f));
    return moves;
}

CurvePoint OrbitCurve::settled(CurvePoint point) const {
    if (point.last_step <= rounding_step) return point;
    ClosingError closing = closing_at(*this, point.y, {});
    if (!closing.simulated) return point;
    point.residual = closing.error.cwiseAbs().maxCoeff();
    point.sticking = closing.sticking;
    point.jacobians = std::move(closing.jacobians);
    point.last_step = 0.0;
    find_multipliers(point, autonomous());
    return point;
}

VectorXd OrbitCurve::crossing_direction(const CurvePoint& point) const {
    const Index inner = n_ * count_;
    const MatrixXd rows = rows_across({point.tangent});
    const CyclicSystem matrix(point.jacobians, {point.columns, rows.leftCols(inner), rows.rightCols(size() - inner)},
                              scale_);
    VectorXd v = matrix.null_vector();
    v(v.size() - 1) *= setting_->range;
    v -= product(v, point.tangent) * point.tangent;
    return v / norm(v);
}

}  // namespace orbid::periodic
