#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "models/arithmetic/dual.hpp"
#include "models/system/argument_check.hpp"
#include "models/system/kernel_system.hpp"
#include "models/system/left_loop.hpp"

namespace orbid::models {

namespace {

using Free = std::optional<std::span<const Eigen::Index>>;

/// Replaces the rate by [angle(t + delay) - angle(t)] / delay; both angles as the instrument reads them.
FlowStatus difference_quotient(const KernelSystem& system, const Kernel& kernel, const Sensor& sensor,
                               const Eigen::VectorXd& state, double phase, const Eigen::VectorXd& theta,
                               const Free& free, const FlowOptions& options, Eigen::Ref<Eigen::VectorXd> reading,
                               Eigen::Ref<Eigen::MatrixXd> derivative) {
    const std::array<double, 1> delay{sensor.delay};
    const auto angle = static_cast<Eigen::Index>(sensor.angle);
    const auto rate = static_cast<Eigen::Index>(sensor.rate);
    const FlowResult later =
        free ? system.flow_with_sensitivities(state, phase, delay, theta, *free, Clock::time, options)
             : system.flow(state, phase, delay, theta, Clock::time, options);
    if (later.status != FlowStatus::ok) return later.status;
    const Eigen::Index n = system.dimension();
    const Eigen::Index directions = derivative.cols();
    Eigen::VectorXd later_reading(n);
    Eigen::MatrixXd at_later = Eigen::MatrixXd::Zero(n, directions);
    kernel.instrument(later.states.data(), theta.data(), free.value_or(std::span<const Eigen::Index>{}),
                      later_reading.data(), free ? at_later.data() : nullptr);
    reading[rate] = (later_reading[angle] - reading[angle]) / sensor.delay;
    if (free) {
        // Chain rule: through the later state, and directly through the parameters of the instrument.
        Eigen::RowVectorXd total = at_later.row(angle).leftCols(n) * later.sensitivities;
        total.rightCols(directions - n) += at_later.row(angle).rightCols(directions - n);
        derivative.row(rate) = (total - derivative.row(angle)) / sensor.delay;
    }
    return FlowStatus::ok;
}

/// The formulas of a sensor at one state after the other. Its arrays live as long as itself: a formula costs no
/// allocation.
class FunctionReader {
public:
    FunctionReader(const Sensor& sensor, const Eigen::VectorXd& theta, Eigen::Index n, std::size_t inputs,
                   const Free& free)
        : sensor_(&sensor),
          n_(n),
          first_input_(static_cast<std::size_t>(n + theta.size())),
          derivatives_(free.has_value()) {
        const std::size_t count = first_input_ + inputs;
        values_.resize(count);
        duals_.resize(derivatives_ ? count : 0);
        // Column of the derivatives for each name; -1: a parameter that is held, or an input.
        column_.assign(count, -1);
        for (Eigen::Index i = 0; i < n; ++i)
            column_[static_cast<std::size_t>(i)] = i;
        for (std::size_t j = 0; derivatives_ && j < free->size(); ++j)
            column_[static_cast<std::size_t>(n + (*free)[j])] = n + static_cast<Eigen::Index>(j);
        for (Eigen::Index i = 0; i < theta.size(); ++i)
            set(static_cast<std::size_t>(n + i), theta[i]);
        for (const FunctionReading& reading : sensor.functions) {
            directions_.emplace_back();
            for (const std::size_t name : reading.expression.used())
                if (column_[name] >= 0) directions_.back().push_back(name);
        }
    }

    /// @param inputs  measured ones at this instant
    FlowStatus read(const Eigen::VectorXd& state, const double* inputs, Eigen::Ref<Eigen::VectorXd> reading,
                    Eigen::Ref<Eigen::MatrixXd> derivative) {
        for (std::size_t i = first_input_; i < values_.size(); ++i)
            set(i, inputs[i - first_input_]);
        for (Eigen::Index i = 0; i < n_; ++i)
            set(static_cast<std::size_t>(i), state[i]);
        bool finite = true;
        for (std::size_t f = 0; f < sensor_->functions.size(); ++f) {
            const auto row = static_cast<Eigen::Index>(sensor_->functions[f].coordinate);
            const Expression& expression = sensor_->functions[f].expression;
            reading[row] = expression.evaluate(std::span<const double>(values_), value_stack_);
            finite = finite && std::isfinite(reading[row]);
            if (derivatives_) differentiate(expression, directions_[f], derivative.row(row));
        }
        return finite ? FlowStatus::ok : FlowStatus::not_finite;
    }

private:
    // Formulas use a few names; four partials fill two or one vector registers.
    static constexpr std::size_t chunk = 4;
    using Scalar = Dual<chunk>;

    void set(std::size_t name, double value) {
        values_[name] = value;
        if (derivatives_) duals_[name] = Scalar(value);
    }

    void differentiate(const Expression& expression, const std::vector<std::size_t>& directions,
                       Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> row) {
        row.setZero();
        for (std::size_t first = 0; first < directions.size(); first += chunk) {
            const std::size_t size = std::min(chunk, directions.size() - first);
            for (std::size_t i = 0; i < size; ++i)
                duals_[directions[first + i]] = Scalar::variable(values_[directions[first + i]], i);
            const Scalar result = expression.evaluate(std::span<const Scalar>(duals_), dual_stack_);
            for (std::size_t i = 0; i < size; ++i) {
                row[column_[directions[first + i]]] = result.partial[i];
                duals_[directions[first + i]] = Scalar(values_[directions[first + i]]);
            }
        }
    }

    const Sensor* sensor_;
    Eigen::Index n_;
    std::size_t first_input_;  ///< among the names
    bool derivatives_;
    std::vector<Eigen::Index> column_;
    std::vector<std::vector<std::size_t>> directions_;  ///< per formula: its names with derivatives
    std::vector<double> values_, value_stack_;
    std::vector<Scalar> duals_, dual_stack_;
};

/// Whether a formula of the sensor uses a measured input.
bool reads_input(const KernelSystem& system, const Sensor& sensor) {
    if (sensor.type != Sensor::Type::function) return false;
    const std::size_t first = system.coordinates().size() + system.parameters().size();
    return std::any_of(sensor.functions.begin(), sensor.functions.end(), [first](const FunctionReading& reading) {
        return !reading.expression.used().empty() && reading.expression.used().back() >= first;
    });
}

}  // namespace

ReadingResult KernelSystem::readings(const Sensor& sensor, const Eigen::MatrixXd& states,
                                     std::span<const double> phases, const Eigen::VectorXd& theta,
                                     std::optional<std::span<const Eigen::Index>> free,
                                     const FlowOptions& options) const {
    check_parameters(*this, theta);
    check_columns(*this, states, phases);
    check_sensor(*this, sensor);
    check_options(options);
    if (free) check_free(*this, *free);
    if (reads_input(*this, sensor)) require_input();
    const Eigen::Index n = dimension();
    const Eigen::Index directions = free ? n + static_cast<Eigen::Index>(free->size()) : 0;
    ReadingResult result;
    result.readings.resize(n, states.cols());
    result.derivatives.setZero(n, states.cols() * directions);
    // Columns are independent; one that cannot be continued gives the status of all, the first one winning.
    std::vector<FlowStatus> status(static_cast<std::size_t>(states.cols()), FlowStatus::ok);
    const auto range_of_columns = [&](Eigen::Index begin, Eigen::Index end) {
        std::optional<FunctionReader> functions;
        std::vector<double> input;
        if (sensor.type == Sensor::Type::function) functions.emplace(sensor, theta, n, inputs().size(), free);
        for (Eigen::Index k = begin; k < end; ++k) {
            Eigen::Ref<Eigen::VectorXd> reading = result.readings.col(k);
            Eigen::Ref<Eigen::MatrixXd> derivative = result.derivatives.middleCols(k * directions, directions);
            kernel_->instrument(states.col(k).data(), theta.data(), free.value_or(std::span<const Eigen::Index>{}),
                                reading.data(), free ? derivative.data() : nullptr);
            FlowStatus& here = status[static_cast<std::size_t>(k)];
            if (sensor.type == Sensor::Type::angle_difference)
                here = difference_quotient(*this, *kernel_, sensor, states.col(k), phases[static_cast<std::size_t>(k)],
                                           theta, free, options, reading, derivative);
            if (functions)
                here = functions->read(states.col(k), input_at(phases[static_cast<std::size_t>(k)], input), reading,
                                       derivative);
        }
    };
    if (sensor.type == Sensor::Type::state) {
        range_of_columns(0, states.cols());
    } else {
        // 64 short flows take some ten microseconds, 1024 formulas likewise: well above the cost of a task.
        const Eigen::Index grain = sensor.type == Sensor::Type::function ? 1024 : 64;
        oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<Eigen::Index>(0, states.cols(), grain),
                                  [&](const oneapi::tbb::blocked_range<Eigen::Index>& range) {
                                      range_of_columns(range.begin(), range.end());
                                  });
        stop_if_left();
    }
    for (const FlowStatus s : status)
        if (s != FlowStatus::ok && result.status == FlowStatus::ok) result.status = s;
    return result;
}

}  // namespace orbid::models
