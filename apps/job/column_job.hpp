#pragma once

#include <string>

#include <Eigen/Core>

namespace orbid::apps {

/// One coordinate read from a column of a table:  model value = sign * (column * factor * unit - offset).
struct ColumnJob {
    Eigen::Index coordinate = 0;  ///< index into System::coordinates()
    std::string column;           ///< header in the file
    std::string unit;             ///< of the column; one that orbits::unit_factor knows for the coordinate
    int sign = 1;                 ///< +1 or -1
    double offset = 0.0;          ///< in the coordinate's unit
    double factor = 1.0;          ///< > 0, of the instrument: units per number in the file
};

}  // namespace orbid::apps
