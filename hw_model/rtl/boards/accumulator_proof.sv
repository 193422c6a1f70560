// Proof of accumulator.sv against a model that is one register: what is taken from an address is the sum of all that was added
// to it since it was last taken or swept, however close together the operations are. An operation may come in every cycle, for
// any address. Widths and depth are those of a core: charges of 18 bits in a bank of 4096 words.
//
// It is enough to look at one address, chosen freely by the solver: the `watched` one of watched_memory.sv. Its charge in the
// model is `sum`. Yosys, when `flatten` dissolves the module under proof, connects wires with the attribute hierconn to those of
// the module that have their names. Except for the watched address, only the assertions that make the induction go through
// use them.
module accumulator_proof (
    input logic        clk,
    input logic        valid,
    input logic        take,
    input logic [11:0] address,
    input logic [17:0] addend,
    input logic        sweep,
    input logic [11:0] sweep_address
);
    wire [17:0] taken;
    accumulator #(.WIDTH(18), .DEPTH(4096)) dut (.clk, .valid, .take, .address, .addend, .taken, .sweep, .sweep_address);
    (* hierconn *) wire [11:0] \dut.charges.watched ;
    (* hierconn *) wire [17:0] \dut.charges.word ;
    (* hierconn *) wire        \dut.valid1 ;
    (* hierconn *) wire        \dut.valid2 ;
    (* hierconn *) wire        \dut.valid3 ;
    (* hierconn *) wire        \dut.valid4 ;
    (* hierconn *) wire        \dut.take1 ;
    (* hierconn *) wire        \dut.take2 ;
    (* hierconn *) wire        \dut.sweep1 ;
    (* hierconn *) wire        \dut.sweep2 ;
    (* hierconn *) wire        \dut.write3 ;
    (* hierconn *) wire [11:0] \dut.address1 ;
    (* hierconn *) wire [11:0] \dut.address2 ;
    (* hierconn *) wire [11:0] \dut.address3 ;
    (* hierconn *) wire [11:0] \dut.address4 ;
    (* hierconn *) wire [17:0] \dut.addend1 ;
    (* hierconn *) wire [17:0] \dut.addend2 ;
    (* hierconn *) wire [17:0] \dut.written3 ;
    (* hierconn *) wire [17:0] \dut.written4 ;
    (* hierconn *) wire [17:0] \dut.stored ;

    wire         hit = valid && address == \dut.charges.watched ;
    wire         swept = sweep && sweep_address == \dut.charges.watched ;
    logic [2:0]  age = 0;           // the first cycles are empty
    logic        clean = 0;         // the address was swept once
    logic [17:0] sum, sum1, sum2;   // what the address has; what it had before operations that are one and two cycles old
    logic        taking1 = 0, taking2 = 0;
    always_ff @(posedge clk) begin
        if (age != 5) age <= age + 1;
        if (hit) sum <= take ? 18'd0 : sum + addend;
        if (swept) {clean, sum} <= {1'b1, 18'd0};
        {taking1, sum1} <= {hit && take, sum};
        {taking2, sum2} <= {taking1, sum1};
    end

    // hitN: the operation in cycle N of the pipeline has the watched address. afterN: the charge once it and all older ones are done.
    wire        hit1 = \dut.valid1 && \dut.address1 == \dut.charges.watched ;
    wire        hit2 = \dut.valid2 && \dut.address2 == \dut.charges.watched ;
    wire        hit3 = \dut.valid3 && \dut.address3 == \dut.charges.watched ;
    wire        hit4 = \dut.valid4 && \dut.address4 == \dut.charges.watched ;
    wire [17:0] after3 = hit3 ? \dut.written3 : \dut.charges.word ;
    wire [17:0] after2 = !hit2 ? after3 : \dut.take2 ? 18'd0 : taken + \dut.addend2 ;
    wire [17:0] after1 = !hit1 ? after2 : \dut.take1 ? 18'd0 : after2 + \dut.addend1 ;
    always_comb begin
        // The core does not sweep during operations, and sweeps all words before the first one.
        assume (!(sweep && valid));
        if (age != 5) assume (!sweep);
        if (!clean) assume (!valid);
        // The property itself: `taken` comes two cycles after its take.
        if (taking2) assert (taken == sum2);
        // For induction: what the pipeline holds agrees with the model.
        assert (age <= 5);
        if (!clean) assert (!taking1 && !taking2);
        if (age == 5) begin
            assert (taking1 == (hit1 && \dut.take1 && ! \dut.sweep1 ) && taking2 == (hit2 && \dut.take2 && ! \dut.sweep2 ));
            if (hit1 && \dut.sweep1 ) assert ( \dut.take1 );
            if (hit2 && \dut.sweep2 ) assert ( \dut.take2 );
        end else begin
            assert (!clean && (age < 1 || ! \dut.valid1 ) && (age < 2 || ! \dut.valid2 ) && (age < 3 || ! \dut.valid3 ));
            assert (age < 4 || ! \dut.valid4 );
        end
        if (age == 5 && !clean) assert (!hit1 && !hit2 && !hit3 && !hit4);
        if (clean) begin
            assert (sum == after1);
            if (hit1 && ! \dut.sweep1 ) assert (sum1 == after2);
            if (hit2 && ! \dut.sweep2 ) assert (sum2 == taken && taken == after3);
            if (hit3 && ! \dut.write3 ) assert ( \dut.written3 == \dut.charges.word );
            if (hit4) assert ( \dut.written4 == \dut.charges.word );
            if (hit1 && ! \dut.sweep1 && !hit2 && !hit3 && !hit4) assert ( \dut.stored == \dut.charges.word );
        end
    end
endmodule
