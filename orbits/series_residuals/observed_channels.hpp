#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/system/system.hpp"
#include "orbits/records/error_form.hpp"
#include "orbits/records/series.hpp"
#include "orbits/series_residuals/input_delay.hpp"
#include "orbits/series_residuals/shooting_plan.hpp"

namespace orbid::orbits {

/// What a residual of a recorded series observes: checks and choices common to all of them. Checks of the record throw
/// DataError, those of the call std::invalid_argument; the message begins with `who`.
class ObservedChannels {
public:
    /// @param system  and `series`: outlive this object.
    ObservedChannels(std::string_view who, const models::System& system, const Series& series)
        : who_(who), system_(system), series_(series) {}

    /// @throws DataError
    template <class... Values>
    void require(bool rule, fmt::format_string<Values...> message, Values&&... values) const {
        if (!rule) refuse(false, fmt::format(message, std::forward<Values>(values)...));
    }
    /// @throws std::invalid_argument
    template <class... Values>
    void require_call(bool rule, fmt::format_string<Values...> message, Values&&... values) const {
        if (!rule) refuse(true, fmt::format(message, std::forward<Values>(values)...));
    }
    /// @param start  of the estimated parameters; may be empty.
    void check_binding(const models::ParameterBinding& binding, const Eigen::VectorXd& start) const;
    /// Refuses samples in time for a map.
    void check_clock() const;
    /// The coordinates named, each once; all of the series, which then are named, where none was.
    [[nodiscard]] std::vector<ObservedCoordinate> chosen(std::vector<std::string>& names) const;
    /// One error or none at all for each of `observed` coordinates. @param what  "scales" or "distributions".
    void check_count(std::size_t errors, std::string_view what, std::size_t observed) const;
    /// Segments that exist, each once; all of them where none was named.
    void choose_segments(std::vector<std::size_t>& segments) const;
    /// Refuses errors relative to the size of an angle.
    void check_form(const ErrorForm& form, const models::Sensor& sensor, Eigen::Index coordinate) const;
    /// The systems with their inputs, one per segment of the series; none for a model that reads no inputs. The inputs
    /// must cover what the sensor reads.
    [[nodiscard]] std::vector<std::shared_ptr<const models::System>> with_inputs(
        const std::vector<std::shared_ptr<const models::InputSignal>>& signals, const models::Sensor& sensor,
        const std::optional<InputDelay>& delay = std::nullopt) const;
    /// Refuses a delay that cannot be: of a model without inputs, or estimated although inputs are held or the sensor
    /// reads them, as its derivative would jump or lack a term.
    void check_delay(const InputDelay& delay, const models::ParameterBinding& binding,
                     const std::vector<std::shared_ptr<const models::InputSignal>>& signals,
                     const models::Sensor& sensor) const;
    /// A reading with log-normal errors must be > 0.
    void check_reading(const ErrorForm& form, const Segment& segment, Eigen::Index row, Eigen::Index sample) const;
    /// @return the known sd > 0 of a reading.
    double known_sd(const Segment& segment, Eigen::Index row, Eigen::Index sample) const;
    /// The errors of a coordinate. Their scale is found from the readings unless `scales` has one.
    [[nodiscard]] estimator::Group group(const std::string& residual, Eigen::Index coordinate, std::size_t place,
                                         const std::vector<estimator::ErrorScale>& scales,
                                         const std::vector<ErrorForm>& forms) const;

private:
    [[noreturn]] void refuse(bool call, const std::string& message) const;

    std::string_view who_;
    const models::System& system_;
    const Series& series_;
};

/// d delay / d(parameter) likewise: 1 for the parameter that is the delay of the inputs.
[[nodiscard]] Eigen::VectorXd delay_slopes(const std::optional<InputDelay>& delay,
                                           const models::ParameterBinding& binding);

/// d omega / d(parameter) for the estimated parameters of a binding: 1 for the frequency of the forcing, else 0.
[[nodiscard]] Eigen::VectorXd frequency_slopes(const models::System& system, const models::ParameterBinding& binding);

}  // namespace orbid::orbits
