// Eigen's decompositions and products of MatrixXd, compiled once (two to eight seconds each): part
// of the precompiled header, needed by nobody. The kernels are Eigen 3.4's own; other versions do
// without.
#pragma once

#include <Eigen/Dense>

#if EIGEN_WORLD_VERSION == 3 && EIGEN_MAJOR_VERSION == 4
#ifndef ETALON_INSTANTIATE
#define ETALON_INSTANTIATE extern
#endif

namespace Eigen {
ETALON_INSTANTIATE template class JacobiSVD<MatrixXd>;
ETALON_INSTANTIATE template class SelfAdjointEigenSolver<MatrixXd>;
ETALON_INSTANTIATE template SelfAdjointEigenSolver<MatrixXd>&
SelfAdjointEigenSolver<MatrixXd>::compute<MatrixXd>(const EigenBase<MatrixXd>&, int);
ETALON_INSTANTIATE template class LLT<MatrixXd>;
ETALON_INSTANTIATE template LLT<MatrixXd>& LLT<MatrixXd>::compute<MatrixXd>(
    const EigenBase<MatrixXd>&);
ETALON_INSTANTIATE template class LDLT<MatrixXd>;
ETALON_INSTANTIATE template LDLT<MatrixXd>& LDLT<MatrixXd>::compute<MatrixXd>(
    const EigenBase<MatrixXd>&);
ETALON_INSTANTIATE template class ColPivHouseholderQR<MatrixXd>;
ETALON_INSTANTIATE template class HouseholderQR<MatrixXd>;
ETALON_INSTANTIATE template class PartialPivLU<MatrixXd>;
ETALON_INSTANTIATE template class CompleteOrthogonalDecomposition<MatrixXd>;

// Solving for a vector or a matrix.
#define ETALON_SOLVING(Solver)                                                                 \
    ETALON_INSTANTIATE template void Solver<MatrixXd>::_solve_impl(const VectorXd&, VectorXd&) \
        const;                                                                                 \
    ETALON_INSTANTIATE template void Solver<MatrixXd>::_solve_impl(const MatrixXd&, MatrixXd&) const
ETALON_SOLVING(LLT);
ETALON_SOLVING(LDLT);
ETALON_SOLVING(ColPivHouseholderQR);
ETALON_SOLVING(HouseholderQR);
ETALON_SOLVING(PartialPivLU);
ETALON_SOLVING(CompleteOrthogonalDecomposition);
#undef ETALON_SOLVING

namespace internal {
ETALON_INSTANTIATE template struct general_matrix_matrix_product<
    Index, double, ColMajor, false, double, ColMajor, false, ColMajor, 1>;
ETALON_INSTANTIATE template struct general_matrix_matrix_product<
    Index, double, RowMajor, false, double, ColMajor, false, ColMajor, 1>;
ETALON_INSTANTIATE template struct general_matrix_matrix_product<
    Index, double, ColMajor, false, double, RowMajor, false, ColMajor, 1>;
ETALON_INSTANTIATE template struct general_matrix_vector_product<
    Index, double, const_blas_data_mapper<double, Index, ColMajor>, ColMajor, false, double,
    const_blas_data_mapper<double, Index, ColMajor>, false, 0>;
ETALON_INSTANTIATE template struct general_matrix_vector_product<
    Index, double, const_blas_data_mapper<double, Index, RowMajor>, RowMajor, false, double,
    const_blas_data_mapper<double, Index, ColMajor>, false, 0>;
ETALON_INSTANTIATE template struct general_matrix_vector_product<
    Index, double, const_blas_data_mapper<double, Index, RowMajor>, RowMajor, false, double,
    const_blas_data_mapper<double, Index, RowMajor>, false, 0>;
#define ETALON_TRIANGULAR(shape, order)                                                          \
    ETALON_INSTANTIATE template struct triangular_solve_vector<double, double, Index, OnTheLeft, \
                                                               shape, false, order>;             \
    ETALON_INSTANTIATE template struct triangular_solve_matrix<double, Index, OnTheLeft, shape,  \
                                                               false, order, ColMajor, 1>
ETALON_TRIANGULAR(Lower, ColMajor);
ETALON_TRIANGULAR(UnitLower, ColMajor);
ETALON_TRIANGULAR(Upper, ColMajor);
ETALON_TRIANGULAR(Upper, RowMajor);
ETALON_TRIANGULAR(UnitUpper, RowMajor);
#undef ETALON_TRIANGULAR
}  // namespace internal
}  // namespace Eigen

#undef ETALON_INSTANTIATE
#endif
